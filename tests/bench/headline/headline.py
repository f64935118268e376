#!/usr/bin/env python3
"""headline.py: runs the rows of the README's table of results, each with several seeds of data and of the first weights.

    tests/bench/headline/headline.py [--build build] [--seeds 5] [ROW ...]    runs the rows, all by default, and writes
                                                                               results.json beside this script
    tests/bench/headline/headline.py --table                                  prints the table that the README has

Seed k draws its own training data and its own test data, and is the seed of the fit. results.json has the errors of each
seed, the CPU time of propose and fit, the baseline with the same data, and the commit of the program that made them.
"""
import argparse
import json
import math
import os
import pathlib
import random
import resource
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path += [str(HERE.parent / "sensors"), str(HERE.parent / "zoo")]
import bench_sensors

RESULTS = HERE / "results.json"


def cpu():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def medians(report):
    """{group: median error over test trajectories, %} of `evaluate --json`."""
    return {name: 100 * group["trajectory"]["median"] for name, group in json.loads(report)["groups"].items()}


class Trainer:
    def __init__(self, build, folder, seed):
        self.program, self.folder, self.seed = build / "trainer" / "portmet-train", folder, seed

    def __call__(self, *words):
        return bench_sensors.run(self.program, *words)

    def simulate(self, name, train, test):
        """Data of the truth file `name`: trajectories 0:train to learn from, the others to test on."""
        text = (ROOT / f"configs/truth/{name}.yaml").read_text().splitlines()
        change = {"seed:": f"seed: {7000 + self.seed}", "trajectories:": f"trajectories: {train + test}"}
        text = [next((new for key, new in change.items() if line.startswith(key)), line) for line in text]
        (self.folder / "truth.yaml").write_text("\n".join(text) + "\n")
        data = self.folder / f"{name}.h5"
        if not data.exists():
            self("truth", self.folder / "truth.yaml", "-o", data)
        return data

    def complete(self, scene, training, data, train, test):
        """Errors of a fit to complete states, and its CPU time."""
        weights = self.folder / f"weights_{pathlib.Path(training).stem}"
        before = cpu()
        self("fit", training, "--data", data, "--trajectories", f"0:{train}", "--seed", self.seed, "-o", weights)
        seconds = cpu() - before
        report = self("evaluate", scene, "--weights", weights, "--data", data, "--trajectories", f"{train}:{train + test}", "--json")
        return medians(report), seconds


def pendula(t, training, black_box):
    data = t.simulate("double_pendulum", 40, 10)
    configs = ROOT / "configs"
    own, seconds = t.complete(configs / "double_pendulum.yaml", configs / f"train/{training}.yaml", data, 40, 10)
    other = None
    if black_box:
        other, _ = t.complete(configs / "double_pendulum_free.yaml", configs / "train/double_pendulum_free.yaml", data, 40, 10)
    return own, other, seconds


def gas(t):
    data = t.simulate("gas_containers", 80, 20)
    own, seconds = t.complete(ROOT / "configs/gas_containers.yaml", ROOT / "configs/train/gas_containers.yaml", data, 80, 20)
    import h5py  # the table needs none of these
    import narx
    import numpy as np

    with h5py.File(data) as file:
        z, names = file["z"][:], np.bytes_(file.attrs["state_layout"]).decode().split()
    none = z[:, :, :0]
    guess = narx.predict(z[:80], none[:80], z[80:], none[80:], 1, t.seed)
    other = {}
    for group in own:
        columns = [i for i, name in enumerate(names) if name.startswith(group)]
        norm = [np.sqrt((y[:, :, columns] ** 2).sum((1, 2))) for y in (guess - z[80:], z[80:])]
        other[group] = float(100 * np.median(norm[0] / norm[1]))
    return own, other, seconds


def swing(rng):
    """The angle of a damped pendulum every 0.03 s."""
    q, v, h = rng.uniform(-2, 2), rng.uniform(-2, 2), 0.001
    for k in range(200):
        yield [q]
        for _ in range(30):
            vm, qm = v + h / 2 * (-9.81 * math.sin(q) - 0.3 * v), q + h / 2 * v
            q, v = q + h * vm, v + h * (-9.81 * math.sin(qm) - 0.3 * vm)


def motor(rng):
    """Current and speed of a motor with a fan every 2 ms, under a voltage that is held for 20 ms."""
    i, w, h = 0, rng.uniform(20, 80), 2e-5
    for k in range(150):
        if k % 10 == 0:
            u = rng.randrange(24)
        yield [i, w, u]
        for _ in range(100):
            im, wm = i + h / 2 * (u - 1.2 * i - 0.08 * w) / 0.004, w + h / 2 * (0.08 * i - 1e-4 * w - 2e-6 * w * w) / 8e-5
            i, w = i + h * (u - 1.2 * im - 0.08 * wm) / 0.004, w + h * (0.08 * im - 1e-4 * wm - 2e-6 * wm * wm) / 8e-5


def logger(t, system, dt, header, noise, *inputs):
    """What a logger shows of a system: 12 tables with noise to learn from, 10 without to test on. A NARX has them, too."""
    import numpy as np  # the table needs neither
    import narx

    rng = random.Random(t.seed)
    names = [word.split()[0] for word in header.split(",")[1:]]
    y = len(names) - len(inputs)
    runs = [np.array(list(system(rng))) for _ in range(22)]
    train, test = np.array(runs[:12], dtype=float), np.array(runs[12:], dtype=float)
    train[:, :, :y] += np.array(noise) * np.random.default_rng(t.seed).normal(size=train[:, :, :y].shape)
    for part, rows in ("train", train), ("test", test):
        for number, run in enumerate(rows):
            lines = "".join(f"{dt * k:.3f}," + ",".join(f"{x:.6g}" for x in row) + "\n" for k, row in enumerate(run))
            (t.folder / f"{part}_{number:02d}.csv").write_text(header + "\n" + lines)
    tables = {part: sorted(t.folder.glob(part + "_*.csv")) for part in ("train", "test")}
    model, record, given = t.folder / "model", t.folder / "record.h5", ["--inputs", ",".join(inputs)] if inputs else []
    before = cpu()
    t("propose", "--data", *tables["train"], *given, "--seed", t.seed, "-o", model)
    t("fit", model / "training.yaml", "-o", model / "weights")
    seconds = cpu() - before
    start = [] if inputs else ["--estimate", 50 * dt]
    t("evaluate", model / "scene.yaml", "--weights", model / "weights", "--data", *tables["test"], *start, "--record", record)
    tests = [bench_sensors.read_table(path) for path in tables["test"]]
    own = {name: statistics.median(errors) for name, errors in bench_sensors.errors(record, tests, inputs).items()}
    guess = narx.predict(train[:, :, :y], train[:, :, y:], test[:, :, :y], test[:, :, y:], 50 if start else 1, t.seed)
    square = np.median(np.sqrt(np.mean((guess - test[:, :, :y]) ** 2, axis=1)), axis=0)
    return own, {name: float(100 * s / d) for name, s, d in zip(names, square, test[:, :, :y].std((0, 1)))}, seconds


ROWS = {
    "pendula": ("double pendulum, form of its energies known", lambda t: pendula(t, "double_pendulum", True), "network without structure"),
    "pendula_network": ("the same, energies learned by networks", lambda t: pendula(t, "double_pendulum_network", False), None),
    "gas": ("two gases and a moving wall, energies learned by networks", gas, "NARX"),
    "angle": ("damped pendulum, a logger's angle, 0.5 % noise", lambda t: logger(t, swing, 0.03, "t [s],angle [rad]", 0.005), "NARX"),
    "motor": ("motor, a logger's current, speed, held voltage, 0.5 % noise", lambda t: logger(t, motor, 0.002, "t [s],i [A],w [rad/s],u [V]", [0.03, 0.4], "u"), "NARX"),
}


def number(x):
    return f"{x:.1e}" if x < 1e-3 else f"{x:.2g}" if x < 10 else f"{x:.0f}"


def spread(rows):
    """The group with the largest error: the middle of the seeds' medians, and their range."""
    values, name = max(((sorted(row[name] for row in rows), name) for name in rows[0]), key=lambda group: statistics.median(group[0]))
    return f"{name} {number(statistics.median(values))} ({number(values[0])} to {number(values[-1])})"


def table():
    results = json.loads(RESULTS.read_text())
    lines = ["| system | largest error, % | baseline | CPU, s |", "|---|---|---|---|"]
    for name, (title, _, baseline) in ROWS.items():
        if name in results:
            seeds = results[name]["seeds"]
            others = [row["baseline"] for row in seeds if row["baseline"]]
            other = f"{baseline}: {spread(others)}" if others else "the same" if name == "pendula_network" else ""
            lines.append(f"| {title} | {spread([row['errors'] for row in seeds])} | {other} | {statistics.median(row['seconds'] for row in seeds):.0f} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--table", action="store_true")
    parser.add_argument("row", nargs="*", metavar="ROW", help=", ".join(ROWS))
    a = parser.parse_args()
    if a.table:
        print(table())
        return
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    for name in a.row or ROWS:
        seeds = []
        for seed in range(1, a.seeds + 1):
            with tempfile.TemporaryDirectory() as folder:
                errors, baseline, seconds = ROWS[name][1](Trainer(a.build.resolve(), pathlib.Path(folder), seed))
            seeds.append({"errors": errors, "baseline": baseline, "seconds": round(seconds, 1)})
            print(name, seed, seeds[-1], flush=True)
        results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
        results[name] = {"commit": commit, "seeds": seeds}
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    print(table())


if __name__ == "__main__":
    main()
