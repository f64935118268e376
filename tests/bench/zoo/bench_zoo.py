#!/usr/bin/env python3
"""bench_zoo.py: what propose and fit reach on random systems, nobody's hand on any file.

    bench_zoo.py --seed 1 --count 100 [--first 0] [--kind chain] [--form complete|logger] [--budget 60] [--jobs 1] -o DIR

Each system gets a proposal and a fit of at most `budget` seconds of CPU, and a black box (`--form free`) of the same
CPU time. Prints shares of systems by kind, and writes DIR/systems.csv and DIR/systems.png. README.md explains the columns.
Seeds below 1,000 are for tuning, others for reports.
"""
import argparse
import concurrent.futures
import csv
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import narx
ROOT = HERE.parents[2]
VERDICT = re.compile(r"Verdict: (\w+)")
COLUMNS = ["seed", "number", "kind", "form", "variables", "parts", "inputs", "hidden", "growth", "error", "worst", "worst_group",
           "black_box", "black_box_worst", "production", "temperature", "verdict", "wrong", "ended", "cpu", "black_box_cpu", "problem"]
GOOD_ERROR, GOOD_PRODUCTION, BAD_ERROR = 5.0, 10.0, 1.0  # percent: what makes a verdict wrong
NICE = 15
GRACE = 30.0  # seconds of CPU between the request to stop and the end


def run(command, log, budget, folder):
    """Runs a program niced, for at most `budget` seconds of CPU: then asks it to stop, so that it keeps its best weights.
    Returns (exit code, CPU seconds, stopped)."""
    with open(log, "a") as out:
        print("$", *command, file=out, flush=True)
        child = subprocess.Popen([str(x) for x in command], stdout=out, stderr=subprocess.STDOUT, cwd=folder,
                                 preexec_fn=lambda: os.nice(NICE))
        stopped = False
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                child.returncode = os.waitstatus_to_exitcode(status)
                return child.returncode, usage.ru_utime + usage.ru_stime, stopped
            used = cpu(child.pid)
            if used > budget and not stopped:
                child.send_signal(signal.SIGINT)
                stopped = True
            elif used > budget + GRACE:
                child.kill()
            time.sleep(0.1)


def cpu(pid):
    """CPU seconds of a process and of its children that have ended."""
    try:
        fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return sum(int(x) for x in fields[11:15]) / os.sysconf("SC_CLK_TCK")


def trainer_takes(train, command, option):
    text = subprocess.run([train, command, "--help"], capture_output=True, text=True).stdout
    return option in text


# Errors ---------------------------------------------------------------------------------------------------------------


def errors_of(predicted, true, groups):
    """{group: median over trajectories of RMSE over deviation, %} and the median over trajectories and groups."""
    found, all_of_them = {}, []
    for group, columns in groups.items():
        z = true[:, :, columns]
        spread = np.sqrt(np.mean((z - z.mean(1, keepdims=True)) ** 2, axis=(1, 2)))
        spread = np.maximum(spread, 0.05 * np.median(spread))  # a trajectory that hardly moves
        rmse = np.sqrt(np.mean((predicted[:, :, columns] - z) ** 2, axis=(1, 2)))
        each = np.where(np.isfinite(rmse), 100 * rmse / spread, np.inf)
        found[group] = float(np.median(each))
        all_of_them += list(each)
    return found, float(np.median(all_of_them))


def words(text):
    """An attribute as one text, names separated by blanks."""
    if isinstance(text, np.ndarray):
        return " ".join(words(x) for x in text)
    return text.decode() if isinstance(text, bytes) else str(text)


def complete_columns(folder):
    """{part.group: columns}, and (columns, SI sizes) of the entropies, from the scene and the dataset."""
    import h5py
    with h5py.File(folder / "test.h5") as file:
        names, units = words(file.attrs["state_layout"]).split(), words(file.attrs["units"]).split(";")
    groups, part = {}, None
    for line in (folder / "scene.yaml").read_text().split("ports:")[0].split("boundary_inputs:")[0].splitlines():
        if found := re.match(r"  (\w+):$", line):
            part = found[1]
        if found := re.match(r"      (\w+): \{unit.*columns: \[([^]]*)\]", line):
            groups[f"{part}.{found[1]}"] = [names.index(c) for c in found[2].split(", ")]
    sizes = {"J/K": 1.0, "kJ/K": 1e3, "mJ/K": 1e-3}
    return groups, [(i, sizes[u]) for i, u in enumerate(units) if u in sizes]


def score_complete(folder, record):
    import h5py
    groups, entropies = complete_columns(folder)
    with h5py.File(folder / "test.h5") as file:
        names, true = words(file.attrs["state_layout"]).split(), file["z"][:]
    with h5py.File(record) as file:
        layout, z = words(file.attrs["state_layout"]).split(), file["z"][:]
    predicted = np.full(true.shape, np.nan)
    for i, name in enumerate(names):
        if name in layout:
            predicted[: len(z), : z.shape[1], i] = z[:, :, layout.index(name)]
    found, median = errors_of(predicted, true, groups)
    production = np.nan
    if entropies and not json.loads((folder / "report.json").read_text())["baths"]:
        made = lambda z: sum(size * (z[:, -1, i] - z[:, 0, i]) for i, size in entropies)
        truth = np.load(folder / "truth.npz")["production"]
        wrong = made(predicted) - made(true)
        wrong = np.where(np.isfinite(wrong), wrong, np.inf)
        production = float(np.median(100 * np.abs(wrong) / np.maximum(truth, 1e-3 * np.median(truth))))
    return found, median, production


# One system -----------------------------------------------------------------------------------------------------------


def fit(train, folder, training, weights, options, budget, log, out):
    """Fits within what the proposal left of the budget; notes how it ended and what it said."""
    code, used, stopped = run([train, "fit", training, "-o", weights, *options], log, max(budget - out["cpu"], 1.0), folder)
    out["cpu"] += used
    out["ended"] = "stopped" if stopped else str(code)
    verdicts = VERDICT.findall(log.read_text())
    out["verdict"] = verdicts[-1] if verdicts else "none"
    if code not in (0, 12, 13):
        out["problem"] = last_line(log)


def complete(train, folder, budget, black_box):
    """Proposal, fit, black box of equal time: figures of one system."""
    out, log = {}, folder / "log"
    log.unlink(missing_ok=True)
    options = ["--budget", f"{budget / 2:g}"] if trainer_takes(train, "propose", "--budget") else []
    out["cpu"] = 0.0
    code, used, stopped = run([train, "propose", "scene.yaml", "--data", "train.h5", "-o", "training.yaml"] + options, log, budget, folder)
    out["cpu"] += used
    if code:
        out["problem"] = last_line(log)
    else:
        fit(train, folder, "training.yaml", "weights", ["--data", "train.h5"], budget, log, out)
        evaluate(train, folder, "scene.yaml", "weights", "predicted.h5", log, out, "")
    if not black_box:
        return out
    if (folder / "black_box").exists():
        shutil.rmtree(folder / "black_box")
    (folder / "black_box").mkdir()
    free = folder / "black_box.log"
    free.unlink(missing_ok=True)
    code, used, _ = run([train, "propose", "scene.yaml", "--data", "train.h5", "-o", "black_box/training.yaml", "--form", "free"], free, budget, folder)
    out["black_box_cpu"] = used
    if code == 0:
        code, used, _ = run([train, "fit", "black_box/training.yaml", "--data", "train.h5", "-o", "black_box/weights"], free,
                            max(out["cpu"] - used, 1.0), folder)
        out["black_box_cpu"] += used
        scenes = list((folder / "black_box").glob("*scene*.yaml")) or ["scene.yaml"]
        evaluate(train, folder, scenes[0], "black_box/weights", "black_box.h5", free, out, "black_box")
    else:
        out["black_box"] = np.inf
    return out


def evaluate(train, folder, scene, weights, record, log, out, prefix):
    if (folder / record).exists():
        (folder / record).unlink()
    code, _, _ = run([train, "evaluate", scene, "--weights", weights, "--data", "test.h5", "--record", record], log, 60.0, folder)
    if not (folder / record).exists():
        out[prefix or "error"] = np.inf
        out.setdefault("problem", last_line(log))
        return
    found, median, production = score_complete(folder, folder / record)
    group = max(found, key=found.get)
    if prefix:
        out.update({prefix: median, prefix + "_worst": found[group]})
    else:
        out.update(error=median, worst=found[group], worst_group=group, production=production)
        out["groups"] = found


def last_line(log):
    lines = [x for x in log.read_text().splitlines() if x.strip()]
    return lines[-1][:160] if lines else ""


def is_wrong(row):
    """A verdict that says more, or less, than the test trajectories show."""
    error, production = row.get("error", np.inf), row.get("production", np.nan)
    if row.get("verdict") == "good":
        return error > GOOD_ERROR or production > GOOD_PRODUCTION
    return row.get("verdict") in ("poor", "UNFIT") and error < BAD_ERROR


def one(a, number):
    folder = a.output.resolve() / f"{number:03d}"
    folder.mkdir(exist_ok=True)
    row = {"seed": a.seed, "number": number, "form": a.form}
    try:
        report_file = folder / "report.json"
        if not report_file.exists():
            make = [sys.executable, HERE / "make_zoo.py", "--seed", a.seed, "--first", number, "--form", a.form, "-o", a.output.resolve(),
                    "--ntrain", a.ntrain, "--ntest", a.ntest] + (["--nstate", a.nstate] if a.nstate else [])
            code, _, _ = run(make + (["--kind", a.kind] if a.kind else []), folder / "make.log", 600.0, folder)
            if code:
                raise RuntimeError(last_line(folder / "make.log"))
        report = json.loads(report_file.read_text())
        row.update({k: report[k] for k in ("kind", "variables", "parts", "inputs", "hidden", "growth")})
        row.update((complete if a.form == "complete" else logger)(a.train, folder, a.budget, not a.no_black_box))
        row["wrong"] = int(is_wrong(row))
    except Exception as problem:  # one system does not end the others
        row["problem"] = f"{type(problem).__name__}: {problem}"[:160]
    print(line_of(row), flush=True)
    return row


def read_tables(folder, pattern):
    """(names, values [run][time][column]) of CSV files with `t` first."""
    files = sorted(folder.glob(pattern))
    names = [x.split(" [")[0] for x in files[0].read_text().splitlines()[0].split(",")]
    return names[1:], np.array([np.loadtxt(f, delimiter=",", skiprows=1, ndmin=2) for f in files])


def logger(train, folder, budget, black_box):
    """Tables, proposal, fit, free runs on the test tables; a NARX model beside."""
    import h5py
    out, log = {"cpu": 0.0}, folder / "log"
    log.unlink(missing_ok=True)
    pairs = iter((folder / "arguments").read_text().split("\n")[:-1])
    arguments = [x for option, value in zip(pairs, pairs) if trainer_takes(train, "propose", option) for x in (option, value)]
    names, values = read_tables(folder, "test_*.csv")
    inputs = json.loads((folder / "report.json").read_text())["input_names"]
    outputs = [k + 1 for k, name in enumerate(names) if name not in inputs]
    first = max(2, values.shape[1] // 10)  # samples that tell the start of a free run
    if black_box:
        began = time.process_time()
        _, past = read_tables(folder, "train_*.csv")
        held = [k + 1 for k, name in enumerate(names) if name in inputs]
        found = narx.predict(past[:, :, outputs], past[:, :, held], values[:, :, outputs], values[:, :, held], first)
        groups, median = errors_of(found[:, first:], values[:, first:, outputs], {names[k - 1]: [i] for i, k in enumerate(outputs)})
        out.update(black_box=median, black_box_worst=max(groups.values()), black_box_cpu=time.process_time() - began)
    for part in "train", "test":
        code, _, _ = run([train, "import", *sorted(folder.glob(part + "_*.csv")), "-o", part + ".h5"], log, 60.0, folder)
        if code:
            return out | {"problem": last_line(log), "error": np.inf}
    options = ["--budget", f"{budget / 2:g}"] if trainer_takes(train, "propose", "--budget") else []
    shutil.rmtree(folder / "model", ignore_errors=True)
    code, used, stopped = run([train, "propose", "--data", "train.h5", *arguments, "-o", "model", *options], log, budget, folder)
    out["cpu"] += used
    if code and not (stopped and (folder / "model/training.yaml").exists()):  # what is stopped writes the best so far
        return out | {"problem": last_line(log), "error": np.inf}
    fit(train, folder, "model/training.yaml", "model/weights", [], budget, log, out)
    record = folder / "predicted.h5"
    record.unlink(missing_ok=True)
    seconds = values[0, first - 1, 0] - values[0, 0, 0]
    run([train, "evaluate", "model/scene.yaml", "--weights", "model/weights", "--data", "test.h5", "--estimate", f"{seconds:.9g}",
         "--record", record], log, 60.0, folder)
    if not record.exists():
        return out | {"problem": last_line(log), "error": np.inf}
    with h5py.File(record) as file:
        layout, y = words(file.attrs["columns"]).split(), file["y"][:]
    predicted = np.full(values.shape, np.nan)
    for k in outputs:
        if names[k - 1] in layout:
            predicted[: len(y), : y.shape[1], k] = y[:, : values.shape[1], layout.index(names[k - 1])]
    groups, median = errors_of(predicted[:, first:], values[:, first:], {names[k - 1]: [k] for k in outputs})
    worst = max(groups, key=groups.get)
    return out | {"error": median, "worst": groups[worst], "worst_group": worst}


# Reports --------------------------------------------------------------------------------------------------------------


def number_text(x):
    return "-" if x is None or (isinstance(x, float) and np.isnan(x)) else f"{x:.3g}"


def line_of(row):
    return (f"{row['seed']}/{row['number']:<4d} {row.get('kind', '?'):14s} error {number_text(row.get('error')):>8s} % worst "
            f"{number_text(row.get('worst')):>8s} ({row.get('worst_group', '-')})  black box {number_text(row.get('black_box')):>8s}  production "
            f"{number_text(row.get('production')):>8s}  {row.get('verdict', '-')}{' WRONG' if row.get('wrong') else ''}  "
            f"{number_text(row.get('cpu'))} s {row.get('ended', '')} {row.get('problem', '')}")


def table(rows):
    """Lines of shares by kind, in percent."""
    def share(rows, test):
        return f"{100 * sum(map(test, rows)) / len(rows):6.0f}" if rows else "     -"

    def value(row, key):
        x = row.get(key)
        return np.inf if x is None or x == "" or np.isnan(float(x)) else float(x)
    head = f"{'kind':15s}{'systems':>8s}{'<0.1 %':>8s}{'<1 %':>7s}{'<10 %':>7s}{'worst<1':>9s}{'beats box':>11s}{'prod<1 %':>10s}{'wrong':>7s}{'median':>9s}{'CPU, s':>8s}"
    lines = [head]
    for kind in sorted({r.get("kind", "?") for r in rows}) + ["all"]:
        of = [r for r in rows if kind == "all" or r.get("kind", "?") == kind]
        produce = [r for r in of if r.get("production") not in (None, "") and not np.isnan(float(r["production"]))]
        lines.append(f"{kind:15s}{len(of):8d}{share(of, lambda r: value(r, 'error') < 0.1):>8s}{share(of, lambda r: value(r, 'error') < 1):>7s}"
                     f"{share(of, lambda r: value(r, 'error') < 10):>7s}{share(of, lambda r: value(r, 'worst') < 1):>9s}"
                     f"{share(of, lambda r: value(r, 'error') <= value(r, 'black_box') and value(r, 'error') < np.inf):>11s}"
                     f"{share(produce, lambda r: value(r, 'production') < 1):>10s}{share(of, lambda r: r.get('wrong') in (1, '1')):>7s}"
                     f"{np.median([value(r, 'error') for r in of]):9.3g}{np.median([float(r.get('cpu') or 0) for r in of]):8.0f}")
    return lines


def save(rows, folder):
    with open(folder / "systems.csv", "w", newline="") as file:
        out = csv.DictWriter(file, COLUMNS, extrasaction="ignore", restval="")
        out.writeheader()
        out.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    draw(rows, folder / "systems.png")


PICTURE = """set terminal pngcairo size 900,500 font "sans,11"
set output "{path}"
set key left top
set logscale x
set xrange [1e-4:1e3]
set yrange [0:100]
set grid
set xlabel "error of a system, % of the deviation"
set ylabel "share of systems below, %"
plot {curves}
"""


def draw(rows, path):
    """The share of systems whose error is below a value."""
    curves, data = [], []
    for key, title in (("error", "proposal and fit"), ("worst", "proposal and fit, worst group"), ("black_box", "black box")):
        found = sorted(row[key] for row in rows if np.isfinite(row.get(key, np.inf)))
        if found:
            curves.append(f'"-" using 1:2 with steps lw 2 title "{title}"')
            data += [f"{x:.6g} {100 * (k + 1) / len(rows):.6g}" for k, x in enumerate(found)] + [f"1e4 {100 * len(found) / len(rows):.6g}", "e"]
    if curves and shutil.which("gnuplot"):
        text = PICTURE.format(path=path, curves=", ".join(curves)) + "\n".join(data) + "\n"
        subprocess.run(["gnuplot"], input=text, text=True, check=False)


def main():
    p = argparse.ArgumentParser(description="What propose and fit reach on random systems.")
    p.add_argument("--seed", type=int, required=True)
    p.add_argument("--count", type=int, default=10)
    p.add_argument("--first", type=int, default=0)
    p.add_argument("--kind")
    p.add_argument("--form", choices=["complete", "logger"], default="complete")
    p.add_argument("--budget", type=float, default=60.0, help="seconds of CPU for propose and fit together")
    p.add_argument("--no-black-box", action="store_true", help="saves half of the time")
    p.add_argument("--jobs", type=int, default=1)
    p.add_argument("--ntrain", type=int, default=40)
    p.add_argument("--ntest", type=int, default=10)
    p.add_argument("--nstate", type=int)
    p.add_argument("--train", type=pathlib.Path, default=ROOT / "build/trainer/portmet-train")
    p.add_argument("-o", "--output", type=pathlib.Path, required=True)
    a = p.parse_args()
    a.train = a.train.resolve()
    a.output.mkdir(parents=True, exist_ok=True)
    rows = []
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        for future in concurrent.futures.as_completed([pool.submit(one, a, k) for k in range(a.first, a.first + a.count)]):
            rows.append(future.result())
            rows.sort(key=lambda r: r["number"])
            save(rows, a.output)
    print(*table(rows), sep="\n")
    sys.exit(any("error" not in row for row in rows))


if __name__ == "__main__":
    main()
