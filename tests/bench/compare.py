#!/usr/bin/env python3
"""compare.py OLD_BUILD NEW_BUILD [TURNS [BENCH...]]: the speed of two builds side by side.

Runs bench_step, bench_scale, bench_training and bench_lockstep (root: a private network) of both builds in turn, TURNS
times (3), and prints for each row the least CPU time of both and their ratio. Least of several turns, so that other
work on the machine counts little. Each build has configs/ of its own repository: that beside the build folder.
"""
import csv
import pathlib
import re
import subprocess
import sys
import tempfile

LOCKSTEP_ROWS = re.compile(r"in process|processes, own receive")


def run(build, bench, *arguments, network=False):
    source = build.parent
    command = [build / "tests/bench" / f"run_{bench}", *(source / "configs" if a == "CONFIGS" else a for a in arguments)]
    if network:
        command = ["unshare", "-n", "sh", source / "daemon/loopback.sh", *command]
    return subprocess.run(command, cwd=source, check=True, capture_output=True, text=True).stdout


def table(build, bench, key, value, **options):
    """The rows of a bench that writes CSV: {key columns: CPU time, us}."""
    with tempfile.NamedTemporaryFile(suffix=".csv") as file:
        run(build, bench, file.name, "CONFIGS", **options)
        rows = csv.DictReader(open(file.name))
        return {", ".join(row[k] for k in key): float(row[value]) for row in rows if row[value]}


def scale(build):
    rows = {}
    for arguments in ("euler",), ("rk4",), ("euler", "grid"), ("euler", "network"):
        for line in run(build, "bench_scale", "CONFIGS", *arguments).split("\n"):
            column = line.split()
            if len(column) > 5 and column[0].isdigit():
                rows[f"{' '.join(arguments)}, {column[0]} links, step of a link"] = float(column[1]) / 1000
    return rows


def lockstep(build):
    rows = table(build, "bench_lockstep", ("scene", "subsystems", "how", "window"), "cpu_us", network=True)
    return {key: time for key, time in rows.items() if LOCKSTEP_ROWS.search(key)}


BENCHES = {
    "bench_step": lambda build: table(build, "bench_step", ("what",), "median_us"),
    "bench_scale": scale,
    "bench_training": lambda build: table(build, "bench_training", ("what",), "median_us"),
    "bench_lockstep": lockstep,
}


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    old, new = (pathlib.Path(folder).resolve() for folder in sys.argv[1:3])
    turns = int(sys.argv[3]) if len(sys.argv) > 3 else 3
    for bench in sys.argv[4:] or BENCHES:
        least = {old: {}, new: {}}
        for _ in range(turns):
            for build in old, new:
                for row, time in BENCHES[bench](build).items():
                    least[build][row] = min(time, least[build].get(row, time))
        print(f"{bench:60}  old, us  new, us  ratio")
        for row, time in least[old].items():
            other = least[new].get(row)
            print(f"  {row:54} {time:12.3f}" + (f" {other:12.3f} {other / time:6.3f}" if other else "  (none)"), flush=True)


if __name__ == "__main__":
    main()
