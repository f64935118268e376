#!/usr/bin/env python3
"""bench_sensors.py: from a logger's files to predictions, without a hand on any file.

    tests/bench/sensors/bench_sensors.py FOLDER [--inputs A,B] [--seeds 3] [--build build] [-- options of propose]

FOLDER has the tables train_*.csv and test_*.csv. For each seed the script proposes, fits and rolls out from the first
sample of each test file. It prints the root mean square error of each column, in % of the column's deviation
over all test files: the median over test files; with it the CPU time of both commands.
"""
import argparse
import array
import csv
import math
import pathlib
import re
import resource
import statistics
import subprocess
import sys
import tempfile


def run(*command, quiet=True):
    done = subprocess.run([str(word) for word in command], capture_output=quiet, text=True)
    if done.returncode not in (0, 13):
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def read_dataset(path):
    """The numbers of a recording of evaluate, its shape and its columns: states /z, or columns /y if starts were estimated."""
    raw = path.with_suffix(".raw")
    header = run("h5dump", "-A", path)
    name, attribute = ("z", "state_layout") if '"state_layout"' in header else ("y", "columns")
    run("h5dump", "-d", f"/{name}", "-b", "LE", "-o", raw, path)
    numbers = array.array("d", raw.read_bytes())
    shape = re.search(rf'DATASET "{name}".*?SIMPLE \{{ \( ([^)]*) \)', header, re.DOTALL)[1]
    columns = re.search(rf'"{attribute}".*?\(0\): "([^"]*)"', header, re.DOTALL)[1]
    return numbers, [int(n) for n in shape.split(",")], columns.split()


def read_table(path):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    names = [re.sub(r"\s*[\[(].*", "", name).strip() for name in rows[0]]
    return {name: [float(row[k]) for row in rows[1:]] for k, name in enumerate(names)}


def errors(record, tests, inputs):
    """{column: [error of each test file, in % of the deviation]}"""
    numbers, (ntrajectory, ntime, ncolumn), columns = read_dataset(record)
    found = {}
    deviation = {name: statistics.pstdev([y for test in tests for y in test[name]]) for name in tests[0]}
    for i in range(ntrajectory):
        for c, name in enumerate(columns):
            if name not in tests[i] or name in inputs:
                continue
            true = tests[i][name]
            own = [numbers[(i * ntime + k) * ncolumn + c] for k in range(ntime)]
            shift = true[0] - own[0]  # a unit with another zero, such as degC
            square = statistics.fmean((a - b - shift) ** 2 for a, b in zip(true, own))
            found.setdefault(name, []).append(100 * math.sqrt(square) / deviation[name])
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--inputs", default="")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build"))
    parser.add_argument("rest", nargs="*")
    a = parser.parse_args()
    train = a.build / "trainer" / "portmet-train"
    tables = sorted(a.folder.glob("train_*.csv")), sorted(a.folder.glob("test_*.csv"))
    tests = [read_table(path) for path in tables[1]]
    for seed in range(1, a.seeds + 1):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            given = ["--inputs", a.inputs] if a.inputs else []
        
            run(train, "propose", "--data", *tables[0], *given, "--seed", seed, "-o", folder, *a.rest)
            run(train, "fit", folder / "training.yaml", "-o", folder / "weights")
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            record = folder / "record.h5"
            run(train, "evaluate", folder / "scene.yaml", "--weights", folder / "weights", "--data", *tables[1], "--record", record)
            found = errors(record, tests, a.inputs.split(","))
            row = "  ".join(f"{name} {statistics.median(e):.3g}" for name, e in found.items())
            print(f"{a.folder.name:12s} seed {seed}: {row} %  ({seconds:.0f} s of CPU)", flush=True)


if __name__ == "__main__":
    main()
