#!/usr/bin/env python3
"""make_zoo.py: random GENERIC systems, each determined by a seed and a number.

    make_zoo.py --seed 1 --count 3 [--first 0] [--kind chain] [--form complete|logger] -o DIR

writes DIR/NUMBER for each: `train.h5`, `test.h5` and `scene.yaml` (complete), or `train_00.csv`, `test_00.csv`, ...
and `arguments` for `propose` (logger). `truth.npz` and `report.json` have what no fit may see. See README.md.
"""
import argparse
import json
import os
import pathlib
import sys

import numpy as np

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(pathlib.Path(__file__).parent))
import generic
from draw import T0, Builder
from generic import Input, Unsuitable
from kinds import KINDS

NTRAIN, NTEST = 40, 10
NOISE = 0.005
ATTEMPTS = 60
EFFORT = {"translation": ("F", "N"), "rotation": ("M", "N m"), "electric": ("U", "V"), "hydraulic": ("dP", "Pa")}
FLOW = {"electric": ("Is", "A"), "hydraulic": ("Qin", "m^3/s")}
OUTER = {"kg m/s": "m", "kg m^2/s": "rad", "Wb": "C", "Pa s": "m^3", "C": "Wb", "m^3": "Pa s"}  # conjugate variables


def add_inputs(b, logger):
    """What the outside does: one or two of an effort, a flow, heating power, and the temperature of a bath."""
    d, s = b.draw, b.system
    for _ in range(d.one((1, 1, 2)) if d.chance(0.7 if logger else 0.2) else 0):
        places = []
        for i, (domain, role) in b.stores.items():
            x0, p0, f0, e0 = b.sizes(domain)
            names = EFFORT if role == "p" else FLOW
            if domain in names:
                places.append(Input(*names[domain], 1.0, "force", i, 1.0, 0.0, d.uniform(0.3, 0.8) * (e0 if role == "p" else f0)))
        for i, law in s.bodies.items():
            if s.variables[i].sensor is None and logger:
                continue
            rate = law.capacity / b.tau
            places.append(Input("Tout", "degC" if logger and b.celsius else "K", 1.0, "bath", i, rate / d.log(3, 30), d.uniform(285, 305), 8.0))
            if logger:
                power = rate * d.uniform(0.2, 0.6)  # never negative: a heater
                places.append(Input("P", "W", 1.0, "power", i, 1.0, power, power))
        places = [x for x in places if x.into not in [y.into for y in s.inputs] and x.name not in [y.name for y in s.inputs]]
        if places:
            s.inputs.append(d.one(places))


def input_values(s, rng, count, held):
    """u(interval, t): staircases whose steps last some samples, or sums of two slow sines."""
    ninput = len(s.inputs)
    if ninput == 0:
        return lambda interval, t: ()
    mean = np.array([e.mean for e in s.inputs])[:, None]
    swing = np.array([e.swing for e in s.inputs])[:, None]
    if held:
        length = int(rng.integers(5, 25))
        levels = rng.uniform(-1, 1, (ninput, s.nstate // length + 1, count))
        return lambda interval, t: mean + swing * levels[:, min(interval, s.nstate - 2) // length]
    phase = rng.uniform(0, 2 * np.pi, (2, ninput, count))
    speed = rng.uniform(0.02, 0.3, (2, ninput, count)) / s.dt * np.array([0.4, 1.0])[:, None, None]
    return lambda interval, t: mean + swing * 0.5 * np.sin(speed * t + phase).sum(0)


def draw_system(seed, number, form, kind=None, ntrain=NTRAIN, ntest=NTEST, nstate=None):
    """The system with its truth: (system, states [time][variable][trajectory], inputs [time][input][trajectory], report)."""
    kinds = list(KINDS)
    kind = kind or kinds[np.random.default_rng([seed, number]).integers(len(kinds))]
    refused = []
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, number, attempt, form == "logger"])
        b = Builder(rng, kind, form == "logger")
        try:
            s = KINDS[kind](b)
            add_inputs(b, form == "logger")
            s.nstate = nstate or s.nstate
            for i, v in enumerate(s.variables):
                v.column = column_name(s, i)
            taken = [v.sensor.name if form == "logger" and v.sensor is not None else v.column for v in s.variables]
            for e in s.inputs:
                e.name += "in" if e.name in taken else ""
            if len(s.variables) > 14:
                raise Unsuitable("many variables")
            return (s,) + trajectories(s, rng, form, ntrain, ntest) + (refused,)
        except Unsuitable as reason:
            refused.append(str(reason))
    raise RuntimeError(f"seed {seed}, number {number}, {kind}: no draw is usable: {refused}")


def trajectories(s, rng, form, ntrain, ntest):
    count, extra = ntrain + ntest, 4
    z0 = s.start(rng, count)
    u = input_values(s, rng, count, form == "logger")
    size = np.std(z0, axis=1, keepdims=True)
    size = np.where(size > 0, size, np.array([v.size for v in s.variables])[:, None])
    # The last trajectories repeat the first ones with starts that differ a little.
    shift = rng.normal(size=(len(z0), extra)) * 1e-6 * size
    for i, v in enumerate(s.variables):
        if v.group == "g":
            shift[i] = 0
    all_z = np.hstack([z0, z0[:, :extra] + shift])

    def all_u(interval, t):
        value = u(interval, t)
        return np.hstack([value, value[:, :extra]]) if len(s.inputs) else value
    states = s.truth(all_z, all_u)
    n = len(s.variables)
    scale = np.maximum(s.deviation(states), 1e-6 * size)
    if not np.all(s.deviation(states) > 1e-9 * size):
        raise Unsuitable("at rest")
    near, far = [np.sqrt(np.sum(((states[t, :n, count:] - states[t, :n, :extra]) / scale) ** 2, axis=0)) for t in (0, -1)]
    growth = float(np.median(far / near))
    if growth > generic.GROWTH:
        raise Unsuitable("chaotic")
    states = states[:, :, :count]
    temperatures = np.array([s.gradient(z[:n])[0][sorted(s.bodies)] for z in states[:: max(1, len(states) // 10)]])
    if temperatures.size and not (temperatures.min() > 200 and temperatures.max() < 500):
        raise Unsuitable("temperatures")
    drift, fall = s.check(states)
    inputs = np.array([u(i, i * s.dt) for i in range(s.nstate)]) if s.inputs else np.zeros((s.nstate, 0, count))
    s.substeps = s.user_substeps(states[:, :, :12], lambda i, t: u(i, t)[:, :12] if s.inputs else ())
    report = {"growth": growth, "drift": float(drift), "fall": float(fall)}
    report["temperatures"] = [float(temperatures.min()), float(temperatures.max())] if temperatures.size else []
    return states, inputs, report


def column_name(s, i):
    """A column's name from group, component and part, as short as is unique."""
    v = s.variables[i]
    group = [j for j, w in enumerate(s.variables) if (w.part, w.group) == (v.part, v.group)]
    several = len({w.part for w in s.variables if w.group == v.group}) > 1
    name = v.group + (f"_{v.part}" if several else "")
    return name + (f"_{group.index(i)}" if len(group) > 1 else "")


# What a user of complete states has --------------------------------------------------------------------------------


def parts_of(s):
    parts = {}
    for i, v in enumerate(s.variables):
        parts.setdefault(v.part, {}).setdefault(v.group, []).append(i)
    return parts


def ports_of(s, rng):
    """Ports between parts: for each pair of parts the groups that its couplings act on or read."""
    v = s.variables
    exposed = {}

    def touch(members, reads):
        parts = list(dict.fromkeys(v[i].part for i in members))
        assert len(parts) <= 2, (s.kind, parts)
        if len(parts) == 2:
            port = exposed.setdefault(tuple(sorted(parts, key=order)), {p: [] for p in parts})
            for i in list(members) + [i for i in reads if v[i].part in parts]:
                if v[i].group not in port[v[i].part]:
                    port[v[i].part].append(v[i].group)
    order = list(parts_of(s)).index
    for index, _ in s.energies:
        assert len({v[i].part for i in index}) == 1, (s.kind, "an energy of two parts")
    for i, j, _, reads in s.pairs:
        # The entropies that one current carries stand in one port.
        touch([i, j] + [to for k, to, _, _ in s.pairs if k == i and j in s.bodies and to in s.bodies], reads)
    for e in s.frictions:
        touch([i for i, _ in e.along] + [i for i, _ in e.sinks], e.reads)
    for e in s.conductions:
        touch([e.a, e.b], [])
    parts = parts_of(s)
    for ends, port in exposed.items():
        generous = rng.uniform() < 0.3
        for part in ends:
            port[part] = [g for g in parts[part] if g in port[part] or generous]
    return exposed


def structure_of(s):
    """What the system consists of, in words, for whoever asks why a fit failed."""
    name = [v.column for v in s.variables]
    lines = ["energy of " + ", ".join(name[i] for i in index) for index, _ in s.energies]
    lines += [f"{name[i]}' = c dE/d{name[j]}, {name[j]}' = -c dE/d{name[i]}, c "
              + (f"depends on {', '.join(name[k] for k in reads)}" if callable(c) else f"= {c:.4g}") for i, j, c, reads in s.pairs]
    for e in s.frictions:
        along = " + ".join(f"({c:.3g}) dE/d{name[i]}" if not callable(c) else f"c(z) dE/d{name[i]}" for i, c in e.along)
        lines.append(f"loss along {along}, heats {', '.join(f'{name[k]} ({w:.2g})' for k, w in e.sinks)}")
    lines += [f"conduction between {name[e.a]} and {name[e.b]}" for e in s.conductions]
    return lines + [f"input {e.name} [{e.unit}]: {e.kind} into {name[e.into]}" for e in s.inputs]


def write_scene(s, rng, path):
    parts, exposed = parts_of(s), ports_of(s, rng)
    lines = [f"# {s.title[0].upper() + s.title[1:]}.", "scene: system", "",
             f"time: {{dt: {s.dt!r}, steps: {s.nstate - 1}, integrator: rk4, substeps: {s.substeps}}}", "", "subsystems:"]
    for part, groups in parts.items():
        lines += [f"  {part}:", f"    weights: weights/{part}.h5", "    state:"]
        for group, members in groups.items():
            base = s.variables[members[0]].relative_to
            relative = f", relative_to: {s.variables[base].part}.{s.variables[base].group}" if base is not None else ""
            columns = ", ".join(s.variables[i].column for i in members)
            lines.append(f'      {group}: {{unit: "{s.variables[members[0]].unit}", columns: [{columns}]{relative}}}')
    ports = []
    if s.inputs:
        lines += ["", "boundary_inputs:"]
    for e in s.inputs:
        v = s.variables[e.into]
        group = [k for k in s.variables if (k.part, k.group) == (v.part, v.group)]
        where = ["0.0"] * len(group)
        where[[id(k) for k in group].index(id(v))] = e.name
        outer = "s: {unit: J/K, dE: [%s], dS: [1]}" % e.name if e.kind == "bath" else (
            "y: {unit: %s, dE: [%s]}" % (OUTER[v.base], ", ".join(where)))
        lines += [f"  outside{len(ports)}:", "    " + outer]
        ports.append((f"input{len(ports)}", f"outside{len(ports)}", v.part, "s" if e.kind == "bath" else "y", v.group))
    if exposed or ports:
        lines += ["", "ports:"]
    for ends, port in exposed.items():
        name = "_".join(ends)
        shown = ", ".join(f"{p}: [{', '.join(port[p])}]" for p in ends)
        lines += [f"  {name}:", "    law: bracket", f"    between: [{', '.join(ends)}]", f"    expose: {{{shown}}}",
                  f"    weights: weights/{name}.h5"]
    for name, outside, part, outer, group in ports:
        lines += [f"  {name}:", "    law: bracket", f"    between: [{outside}, {part}]",
                  f"    expose: {{{outside}: [{outer}], {part}: [{group}]}}", f"    weights: weights/{name}.h5"]
    lines += ["", "reference: {file: test.h5, trajectory: 0}", ""]
    path.write_text("\n".join(lines))


def absolute(s, states):
    """The states, with the sum of both where one is measured from another one."""
    result = np.array(states[:, :len(s.variables)])
    for i, v in enumerate(s.variables):
        if v.relative_to is not None:
            result[:, i] += result[:, v.relative_to]
    return result


def columns_of(s, states):
    """The columns of the dataset: states in their units."""
    return absolute(s, states) / np.array([v.si for v in s.variables])[None, :, None]


def write_complete(s, states, inputs, seed, number, path, ntrain):
    import h5py
    rng = np.random.default_rng([seed, number, 7])
    write_scene(s, rng, path / "scene.yaml")
    data = np.concatenate([columns_of(s, states), inputs], axis=1)
    for name, chosen in ("train.h5", slice(0, ntrain)), ("test.h5", slice(ntrain, None)):
        with h5py.File(path / name, "w") as file:
            file["z"] = np.ascontiguousarray(np.transpose(data[:, :, chosen], (2, 0, 1)))
            file["t"] = s.dt * np.arange(s.nstate)
            file["dt"] = s.dt
            file.attrs["state_layout"] = " ".join([v.column for v in s.variables] + [e.name for e in s.inputs])
            file.attrs["units"] = ";".join([v.unit for v in s.variables] + [e.unit for e in s.inputs])


# What a logger writes ------------------------------------------------------------------------------------------------


def readings(s, states):
    """(names, units, parts, values [time][column][trajectory]) of all that has a sensor."""
    n = len(s.variables)
    dE = np.array([s.gradient(z[:n])[0] for z in states])
    places = absolute(s, states)
    names, units, parts, values = [], [], [], []
    for i, v in enumerate(s.variables):
        if v.sensor is None:
            continue
        same = [w for w in s.variables if w.sensor is not None and w.sensor.name == v.sensor.name]
        names.append(v.sensor.name if len(same) == 1 else f"{v.sensor.name}{[id(w) for w in same].index(id(v)) + 1}")
        while names[-1] in names[:-1]:  # phi2 beside two that are called phi
            names[-1] += "b"
        units.append(v.sensor.unit)
        parts.append(v.part)
        shown = dE[:, i] if v.sensor.coenergy else places[:, i]
        values.append(shown * v.sensor.gain + v.sensor.offset)
    return names, units, parts, np.transpose(np.array(values), (1, 0, 2))


def write_logger(s, states, inputs, seed, number, path, ntrain):
    """CSV files; noise on the training files alone. `arguments` is what an engineer adds to `propose`."""
    rng = np.random.default_rng([seed, number, 8])
    names, units, parts, values = readings(s, states)
    count = states.shape[2]
    spread = np.sqrt(np.mean(np.var(values, axis=0), axis=1))[None, :]
    shown = inputs - np.array([273.15 if e.unit == "degC" else 0.0 for e in s.inputs])[None, :, None] if s.inputs else inputs
    header = ",".join(["t [s]"] + [f"{a} [{u}]" for a, u in zip(names + [e.name for e in s.inputs], units + [e.unit for e in s.inputs])])
    for k in range(count):
        seen = values[:, :, k] + (NOISE * spread * rng.normal(size=values.shape[:2]) if k < ntrain else 0.0)
        table = np.column_stack([s.dt * np.arange(s.nstate), seen, shown[:, :, k]])
        name = f"train_{k:02d}.csv" if k < ntrain else f"test_{k - ntrain:02d}.csv"
        np.savetxt(path / name, table, fmt="%.9g", delimiter=",", header=header, comments="")
    arguments = ["--inputs", ",".join(e.name for e in s.inputs)] if s.inputs else []
    own = list(dict.fromkeys(parts))
    if len(own) > 1:
        for part in own:
            arguments += ["--part", f"{part}=" + ",".join(n for n, p in zip(names, parts) if p == part)]
        for ends in ports_of(s, np.random.default_rng(0)):
            if all(p in own for p in ends):
                arguments += ["--port", ",".join(ends)]
    (path / "arguments").write_text("\n".join(arguments) + "\n")


def make(seed, number, form, folder, kind=None, ntrain=NTRAIN, ntest=NTEST, nstate=None):
    """Writes one system and returns its description."""
    s, states, inputs, report, refused = draw_system(seed, number, form, kind, ntrain, ntest, nstate)
    folder.mkdir(parents=True, exist_ok=True)
    (write_complete if form == "complete" else write_logger)(s, states, inputs, seed, number, folder, ntrain)
    report |= {"kind": s.kind, "title": s.title, "variables": len(s.variables), "parts": len(parts_of(s)), "inputs": len(s.inputs),
               "input_names": [e.name for e in s.inputs], "baths": sum(e.kind == "bath" for e in s.inputs),
               "hidden": sum(v.sensor is None and i not in s.bodies for i, v in enumerate(s.variables)) if form == "logger" else 0,
               "dt": s.dt, "states": s.nstate, "substeps": s.substeps, "refused": refused,
               "structure": structure_of(s)}
    production = s.production(states)[ntrain:] if s.bodies else np.zeros(ntest)
    dE = np.array([s.gradient(z[: len(s.variables)])[0] for z in states[:, :, ntrain:]])
    np.savez(folder / "truth.npz", production=production, temperature=dE[:, sorted(s.bodies)])
    (folder / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    return report


def main():
    p = argparse.ArgumentParser(description="Random GENERIC systems, each determined by a seed and a number.")
    p.add_argument("--seed", type=int, required=True)
    p.add_argument("--count", type=int, default=1)
    p.add_argument("--first", type=int, default=0)
    p.add_argument("--kind", choices=list(KINDS))
    p.add_argument("--form", choices=["complete", "logger"], default="complete")
    p.add_argument("--ntrain", type=int, default=NTRAIN)
    p.add_argument("--ntest", type=int, default=NTEST)
    p.add_argument("--nstate", type=int, help="states of a trajectory, instead of 120 to 260")
    p.add_argument("-o", "--output", type=pathlib.Path, required=True)
    a = p.parse_args()
    for number in range(a.first, a.first + a.count):
        report = make(a.seed, number, a.form, a.output / f"{number:03d}", a.kind, a.ntrain, a.ntest, a.nstate)
        print(f"{number:3d} {report['kind']:14s} {report['variables']:2d} variables, {report['parts']} parts, {report['inputs']} inputs, "
              f"{report['states']} states {report['dt']:.2g} s apart, growth {report['growth']:.1f}, energy {report['drift']:.0e}, "
              f"{len(report['refused'])} refused", flush=True)


if __name__ == "__main__":
    main()
