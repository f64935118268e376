#!/usr/bin/env python3
"""test_zoo.py PORTMET_TRAIN: the generator makes what it says, and the bench runs.

- A system of either form fulfils both laws, and its truth agrees with SciPy's Radau.
- The same seed gives the same files.
- The check of the laws fails where one is broken.
- Scores, wrong verdicts and the black box of tables are those of known cases.
- The bench proposes, fits and scores a tiny system, with a black box beside it.
"""
import csv
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from scipy.integrate import solve_ivp

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import bench_zoo
import make_zoo


def agrees_with_radau():
    s, states, _, report, _ = make_zoo.draw_system(1, 0, "complete", "electromagnet", 3, 1, 20)
    s.inputs, s.nstate = [], 6
    z0 = states[0, : len(s.variables), :1]
    ours = s.truth(z0, lambda interval, t: ())[:, :, 0]
    theirs = solve_ivp(lambda t, z: s.rates(z[:, None], ())[:, 0], (0, 5 * s.dt), ours[0], "Radau", s.dt * np.arange(6),
                       rtol=1e-8, atol=1e-8 * np.append(s.deviation(states)[:, 0], [1, 1]))
    error = np.max(np.abs(theirs.y.T - ours)[:, :-2] / s.deviation(states)[:, 0])
    assert theirs.success and error < 1e-5, f"differs from Radau by {error:.1e} deviations"


def breaks_laws():
    s, states, _, _, _ = make_zoo.draw_system(1, 1, "complete", "viscous", 3, 1, 20)
    s.check(states)
    for row in 0, sorted(s.bodies)[0]:  # a position that moves by itself; an entropy that falls
        wrong = states.copy()
        wrong[:, row] -= np.linspace(0, 0.1, len(states))[:, None] * s.variables[row].size
        try:
            s.check(wrong)
        except AssertionError:
            continue
        raise SystemExit(f"FAILED: the check did not notice a change of {s.variables[row].column}")


def repeats(folder):
    for form, kind in ("complete", "heat"), ("logger", "chain"):
        made = []
        for again in "first", "second":
            make_zoo.make(3, 2, form, folder / again / form, kind, 3, 2, 20)
            made.append({p.name: p.read_bytes() for p in (folder / again / form).iterdir() if p.suffix != ".npz"})
        assert made[0].keys() == made[1].keys() and len(made[0]) >= 4
        for name in made[0]:
            assert made[0][name] == made[1][name] or name.endswith(".h5"), f"{form}: {name} differs"
    header = (folder / "first/logger/train_00.csv").read_text().splitlines()[0]
    assert header.startswith("t [s],") and header.count("[") == header.count(",") + 1, header


def scores():
    rng = np.random.default_rng(1)
    true = rng.normal(size=(3, 50, 2))
    spread = np.sqrt(np.mean((true[:, :, :1] - true[:, :, :1].mean(1, keepdims=True)) ** 2, axis=(1, 2)))
    predicted = true.copy()
    predicted[:, :, 0] += 0.1 * spread[:, None]
    found, median = bench_zoo.errors_of(predicted, true, {"a": [0], "b": [1]})
    assert abs(found["a"] - 10) < 1e-9 and found["b"] == 0 and abs(median - 5) < 1e-9, (found, median)
    wrong = [bench_zoo.is_wrong({"verdict": v, "error": e, "production": p})
             for v, e, p in (("good", 6, 1), ("good", 1, 20), ("good", 1, np.nan), ("UNFIT", 0.5, 1), ("poor", 2, 1), ("fair", 50, 50))]
    assert wrong == [True, True, False, True, False, False], wrong
    y, u = np.zeros((12, 60, 2)), np.repeat(rng.normal(size=(12, 12, 1)), 5, axis=1)
    y[:, 0] = rng.normal(size=(12, 2))
    for t in range(59):  # an oscillator under a held input
        y[:, t + 1] = y[:, t] @ np.array([[0.98, -0.15], [0.15, 0.97]]) + 0.1 * u[:, t]
    free = bench_zoo.narx.predict(y[:10], u[:10], y[10:], u[10:], 4)
    assert np.max(np.abs(free - y[10:])) < 1e-3, "the black box misses a linear system"


def bench_runs(train, folder):
    command = [sys.executable, HERE / "bench_zoo.py", "--seed", "1", "--first", "1", "--count", "1", "--kind", "heat", "--ntrain", "10", "--ntest", "2",
               "--nstate", "25", "--budget", "1", "--train", train, "-o", folder / "bench"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    with open(folder / "bench/systems.csv", newline="") as file:
        row, = csv.DictReader(file)
    assert row["kind"] == "heat" and float(row["error"]) < 1e4 and float(row["black_box"]) < 1e9 and float(row["cpu"]) > 0, row
    exact = bench_zoo.score_complete(folder / "bench/001", folder / "bench/001/test.h5")
    assert exact[1] == 0 and exact[2] == 0, exact


def main():
    agrees_with_radau()
    breaks_laws()
    scores()
    with tempfile.TemporaryDirectory() as folder:
        repeats(pathlib.Path(folder))
        bench_runs(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(folder))
    print("5 passed, 0 failed")


if __name__ == "__main__":
    main()
