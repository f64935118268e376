#!/usr/bin/env python3
"""composition.py: learns two masses on springs, each alone, and assembles ten: portmet beside port-Hamiltonian networks.

    tests/bench/composition/composition.py OUT [--train BIN] [--seeds 3] [ROW ...]

The system is that of Neary and Topcu, "Compositional Learning of Dynamical System Models Using Port-Hamiltonian Neural
Networks" (arXiv 2212.00893): mass i hangs on mass i-1 by a spring of elongation q_i, and its damping is b v^3. Nine masses
are submodel 1, and the last one, which a force pushes, is submodel 2. Each row has 100 trajectories of each submodel. The
force in training is a guess from a comment of their program: random, and held over each step. Seed k draws its own data, and
is the seed of the fit. OUT/results.json keeps the errors of each seed; a run goes on where the one before ended.

The rows `network` and `decay` are port-Hamiltonian networks with the sizes and settings that the authors publish, written
anew here in PyTorch (Debian's python3-torch). `decay` differs: 64-bit numbers, three times as many steps, a rate that falls.
"""
import argparse
import json
import os
import pathlib
import resource
import statistics
import subprocess
import time

import h5py
import numpy as np
from scipy.integrate import solve_ivp

DT, STATES, TRAIN, TEST, MASSES, STEPS = 0.01, 500, 100, 20, 10, 2000
SUBMODELS = {1: (1.2, 1.7, 0.0), 2: (1.5, 1.5, 5.0)}  # stiffness, damping, largest force; every mass is 1 kg


def follow(rate, start, forces):
    """The states at the beginning of each step, where a force is held over each step: scipy's DOP853, tolerance 1e-12."""
    states = [np.asarray(start, dtype=float)]
    for force in forces[:-1]:
        states.append(solve_ivp(rate, (0, DT), states[-1], "DOP853", args=(force,), rtol=1e-12, atol=1e-12).y[:, -1])
    return np.array(states)


def simulate(number, seed):
    """Trajectories of a submodel: [trajectory][time][q, p, force]."""
    k, b, largest = SUBMODELS[number]
    rng, n = np.random.default_rng([seed, number]), TRAIN + TEST
    start, force = rng.uniform(-1, 1, (2, n)), largest * rng.uniform(-1, 1, (STATES, n))

    def rate(t, x, f):
        q, p = x.reshape(2, n)
        return np.concatenate([p, f - k * q - b * p**3])

    z = follow(rate, start.ravel(), force).reshape(STATES, 2, n)
    return np.concatenate([z, force[:, None]], axis=1).transpose(2, 0, 1)


def chain():
    """The true trajectory of ten masses: [time][q_0, p_0, ..., q_9, p_9], and the force."""
    k, b = np.array([SUBMODELS[1 if i < MASSES - 1 else 2][:2] for i in range(MASSES)]).T
    start = np.zeros(2 * MASSES)
    start[-2] = 1.0

    def rate(t, x, f):
        q, p = x[::2], x[1::2]
        pull = k * q
        dp = np.append(pull[1:], f) - pull - b * p**3
        return np.column_stack([np.diff(p, prepend=0), dp]).ravel()

    force = np.cos(DT * np.arange(STEPS + 1))
    return follow(rate, start, force), force


def energy(z):
    k = np.array([SUBMODELS[1 if i < MASSES - 1 else 2][0] for i in range(MASSES)])
    return (k * z[:, ::2] ** 2 / 2 + z[:, 1::2] ** 2 / 2).sum(1)


def save(path, z, columns, units):
    with h5py.File(path, "w") as file:
        file["z"], file["t"], file["dt"] = z, DT * np.arange(z.shape[1]), DT
        file.attrs["state_layout"], file.attrs["units"] = " ".join(columns), ";".join(units)


def read(path):
    with h5py.File(path) as file:
        names = np.bytes_(file.attrs["state_layout"]).decode().split()
        return {name: file["z"][:, :, i] for i, name in enumerate(names)}


# What stands in a scene of momenta before the fit. For velocities `propose` writes the scenes itself.
MOMENTA = """scene: submodel{number}
time: {{dt: {dt}, steps: {steps}, integrator: rk4, substeps: 1}}
subsystems:
  system: {{weights: weights/system.h5, state: {{q: {{unit: m, columns: [q]}}, p: {{unit: kg m/s, columns: [p]}}}}}}
boundary_inputs:
  surroundings: {{s: {{unit: J/K, dE: [293.15], dS: [1]}}}}
{source}ports:
  system_losses: {{law: bracket, between: [system, surroundings], expose: {{system: [p], surroundings: [s]}},
                  weights: weights/system_losses.h5}}
{port}"""
SOURCE = "  F_source: {x: {unit: m, dE: [F], hold: previous}}\n"
PORT = """  system_F: {law: bracket, between: [system, F_source], expose: {system: [p], F_source: [x]},
             weights: weights/system_F.h5}
"""

# Ten masses. V is the second variable of a mass: v, a co-energy, or p.
TEN = """scene: ten_masses
time: {{dt: {dt}, steps: {steps}, integrator: rk4, substeps: 1}}
models:
  joint: {{law: bracket, reversible: {{given: [[a.{V}, b.q, 1.0]]}}}}
subsystems:
  "mass[0:{last}]":
    weights: model1/weights/system.h5
    state: {{q: {{unit: m, columns: ["q[i]"]}}, {V}: {{unit: {unit}, {coenergy}columns: ["{V}[i]"]}}}}
  mass{last}:
    weights: model2/weights/system.h5
    state: {{q: {{unit: m, columns: [q{last}]}}, {V}: {{unit: {unit}, {coenergy}columns: [{V}{last}]}}}}
boundary_inputs:
  surroundings: {{s: {{unit: J/K, dE: [293.15], dS: [1]}}}}
  F_source: {{x: {{unit: {x}, dE: [F], hold: previous}}}}
ports:
  "joint[0:{last}]":
    {{law: bracket, between: ["mass[i]", "mass[i+1]"], expose: {{"mass[i]": {V}, "mass[i+1]": q}}, model: joint}}
  "losses[0:{last}]":
    law: bracket
    between: ["mass[i]", surroundings]
    expose: {{"mass[i]": {V}, surroundings: s}}
    weights: model1/weights/system_losses.h5
  losses{last}:
    law: bracket
    between: [mass{last}, surroundings]
    expose: {{mass{last}: {V}, surroundings: s}}
    weights: model2/weights/system_losses.h5
  force:
    law: bracket
    between: [mass{last}, F_source]
    expose: {{mass{last}: {V}, F_source: x}}
    weights: model2/weights/system_F.h5
"""


def portmet(train, folder, seed, data, truth, V):
    """Learns both submodels with the defaults and runs ten masses. V is v or p."""

    def call(*words):
        result = subprocess.run([train, *map(str, words)], check=True, capture_output=True, text=True)
        with open(folder / "log.txt", "a") as log:
            log.write(f"$ {' '.join(map(str, words))}\n{result.stdout}{result.stderr}")
        return result.stdout

    folder.mkdir(parents=True, exist_ok=True)
    unit, x = {"v": ("m/s", "J/(N)"), "p": ("kg m/s", "m")}[V]
    predictions, seconds, verdicts = {}, 0.0, []
    for number, z in data.items():
        model, inputs = folder / f"model{number}", number == 2
        model.mkdir(exist_ok=True)
        columns, units = (["q", V, "F"], ["m", unit, "N"]) if inputs else (["q", V], ["m", unit])
        for part, rows in ("train", z[:TRAIN]), ("test", z[TRAIN:]):
            save(folder / f"{part}{number}.h5", rows[:, :, : len(columns)], columns, units)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        if V == "v":
            given = ["--inputs", "F"] if inputs else []
            call("propose", "--data", folder / f"train{number}.h5", *given, "--seed", seed, "-o", model)
        else:
            text = MOMENTA.format(number=number, dt=DT, steps=STATES - 1, source=SOURCE * inputs, port=PORT * inputs)
            (model / "scene.yaml").write_text(text)
            call("propose", model / "scene.yaml", "--data", folder / f"train{number}.h5", "--seed", seed,
                 "-o", model / "training.yaml")
        report = call("fit", model / "training.yaml", "-o", model / "weights")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds += after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        verdicts += [line.split(".")[0] for line in report.splitlines() if line.startswith("Verdict")]
        call("evaluate", model / "scene.yaml", "--weights", model / "weights", "--data", folder / f"test{number}.h5",
             "--record", folder / f"predicted{number}.h5")
        found = read(folder / f"predicted{number}.h5")
        predictions[number] = np.stack([found["q"], found[V]], axis=2)
    last = MASSES - 1
    (folder / "ten.yaml").write_text(TEN.format(dt=DT, steps=STEPS, V=V, unit=unit, x=x, last=last,
                                                coenergy="coenergy: true, " if V == "v" else ""))
    z, force = truth
    columns = [f"{name}{i}" for i in range(MASSES) for name in ("q", V)]
    save(folder / "ten.h5", np.column_stack([z, force])[None], columns + ["F"], ["m", unit] * MASSES + ["N"])
    call("evaluate", folder / "ten.yaml", "--data", folder / "ten.h5", "--record", folder / "predicted_ten.h5")
    found = read(folder / "predicted_ten.h5")
    return predictions, np.stack([found[name][0] for name in columns], axis=1), seconds, verdicts


def network(seed, data, truth, long):
    """x' = (J - R(x)) dH/dx + g u, H and R networks with two layers of 32 units, rk4, Adam on single steps."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    kind, steps = (torch.float64, 60000) if long else (torch.float32, 20000)

    def layers(outputs):
        nn = torch.nn
        return nn.Sequential(nn.Linear(2, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh(), nn.Linear(32, outputs)).to(kind)

    def gradient(net, x):
        one = torch.tanh(net[0](x))
        two = torch.tanh(net[2](one))
        inner = ((1 - two**2) * net[4].weight) @ net[2].weight
        return ((1 - one**2) * inner) @ net[0].weight

    def loss_of(net, x, d):
        """R dH/dx, with R = L L^T of a lower triangle L."""
        out = net(x)
        a, c, b = out[:, 0].abs(), out[:, 1].abs(), out[:, 2]
        y0, y1 = a * d[:, 0] + b * d[:, 1], c * d[:, 1]
        return torch.stack([a * y0, b * y0 + c * y1], 1)

    def rk4(rate, x):
        k1 = rate(x)
        k2 = rate(x + DT / 2 * k1)
        k3 = rate(x + DT / 2 * k2)
        return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + DT * k3))

    models, predictions, seconds = {}, {}, 0.0
    for number, z in data.items():
        H, R, g = layers(1), layers(3), torch.zeros(2, dtype=kind, requires_grad=True)

        def step(x, u, H=H, R=R, g=g):
            def rate(x):
                d = gradient(H, x)
                return torch.stack([d[:, 1], -d[:, 0]], 1) - loss_of(R, x, d) + g * u

            return rk4(rate, x)

        x = torch.tensor(z[:TRAIN, :-1, :2].reshape(-1, 2), dtype=kind)
        y = torch.tensor(z[:TRAIN, 1:, :2].reshape(-1, 2), dtype=kind)
        u = torch.tensor(z[:TRAIN, :-1, 2:].reshape(-1, 1), dtype=kind)
        optimiser = torch.optim.Adam([*H.parameters(), *R.parameters()] + [g] * (number == 2), lr=1e-3)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps) if long else None
        before = time.process_time()
        for _ in range(steps):
            chosen = torch.randint(len(x), (32,))
            loss = ((step(x[chosen], u[chosen]) - y[chosen]) ** 2).sum() / 32
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            if falling:
                falling.step()
        seconds += time.process_time() - before
        models[number] = H, R, g
        with torch.no_grad():
            state, force = torch.tensor(z[TRAIN:, 0, :2], dtype=kind), torch.tensor(z[TRAIN:, :, 2:], dtype=kind)
            states = [state]
            for i in range(STATES - 1):
                states.append(step(states[-1], force[:, i]))
        predictions[number] = torch.stack(states, 1).numpy()

    (H1, R1, _), (H2, R2, g) = models[1], models[2]

    def rate(x, u):  # x: [mass][q, p]
        d = torch.cat([gradient(H1, x[:-1]), gradient(H2, x[-1:])])
        lost = torch.cat([loss_of(R1, x[:-1], d[:-1]), loss_of(R2, x[-1:], d[-1:])])
        flat = d.reshape(-1)
        change = torch.cat([flat[1:], flat[:1] * 0]) - torch.cat([flat[:1] * 0, flat[:-1]])  # the chain's J, known
        change = change.reshape(-1, 2) - lost
        return torch.cat([change[:-1], change[-1:] + g * u])

    z, force = truth
    with torch.no_grad():
        states = [torch.tensor(z[0].reshape(-1, 2), dtype=kind)]
        for u in force[:-1]:
            states.append(rk4(lambda x, u=u: rate(x, float(u)), states[-1]))
    return predictions, torch.stack(states).reshape(len(states), -1).numpy().astype(float), seconds, []


def score(data, truth, predictions, ten):
    """Errors in %. Those of submodels are relative L2 errors over a trajectory, medians of those unseen. That of the energy
    is the largest over time, over the largest energy."""
    found = {}
    for number, z in data.items():
        true = z[TRAIN:, :, :2]
        ratio = np.sqrt(((predictions[number] - true) ** 2).sum((1, 2)) / (true**2).sum((1, 2)))
        found[f"submodel {number}"] = 100 * float(np.median(ratio))
    z = truth[0]
    for name, first in ("q", 0), ("p", 1):
        error, size = np.linalg.norm((ten - z)[:, first::2], axis=1), np.sqrt((z[:, first::2] ** 2).sum(1).mean())
        found[f"{name}, mean"], found[f"{name}, end"] = 100 * float(error.mean() / size), 100 * float(error[-1] / size)
    found["energy"] = 100 * float(np.abs(energy(ten) - energy(z)).max() / energy(z).max())
    found["mse"] = float(((ten - z) ** 2).mean())
    return found


ROWS = {"velocities": "portmet, q and v", "momenta": "portmet, q and p", "network": "port-Hamiltonian networks, q and p",
        "decay": "the same, 64 bit, 60,000 steps, falling rate"}
COLUMNS = ["submodel 1", "submodel 2", "q, mean", "q, end", "p, mean", "p, end", "energy", "CPU, s"]


def table(results):
    print("| " + " | ".join(["", "seeds", *COLUMNS]) + " |\n|" + "---|" * (len(COLUMNS) + 2))
    for row, name in ROWS.items():
        runs = list(results.get(row, {}).values())
        if runs:
            cells = []
            for column in COLUMNS:
                values = [run[column] for run in runs]
                form = "{:.0f}" if column == "CPU, s" else "{:.2g}"
                middle, low, high = (form.format(f(values)) for f in (statistics.median, min, max))
                cells.append(f"{middle} ({low} to {high})" if len(values) > 1 else middle)
            print("| " + " | ".join([name, str(len(runs)), *cells]) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", metavar="OUT", type=pathlib.Path, help="folder for data, models and results.json")
    parser.add_argument("rows", metavar="ROW", nargs="*", help=f"rows to run: {', '.join(ROWS)}; default: all")
    parser.add_argument("--train", default="build/trainer/portmet-train", help="the program portmet-train (%(default)s)")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each row (%(default)s)")
    options = parser.parse_intermixed_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    options.out.mkdir(parents=True, exist_ok=True)
    kept = options.out / "results.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    truth = chain()
    for seed in range(1, options.seeds + 1):
        data = {number: simulate(number, seed) for number in SUBMODELS}
        for row in options.rows or ROWS:
            if str(seed) in results.get(row, {}):
                continue
            if row in ("velocities", "momenta"):
                folder, second = options.out / f"{row}{seed}", "v" if row == "velocities" else "p"
                predictions, ten, seconds, verdicts = portmet(options.train, folder, seed, data, truth, second)
            else:
                predictions, ten, seconds, verdicts = network(seed, data, truth, row == "decay")
            found = {**score(data, truth, predictions, ten), "CPU, s": seconds, "verdicts": verdicts}
            results.setdefault(row, {})[str(seed)] = found
            kept.write_text(json.dumps(results, indent=1))
            print(row, "seed", seed, found, flush=True)
    table(results)


if __name__ == "__main__":
    main()
