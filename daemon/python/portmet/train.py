# SPDX-License-Identifier: MIT
"""Drives the trainer, portmet-train (trainer/README.md). `data` is a dataset, a table, or a list of tables."""
from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import typing

import numpy

from . import _places
from ._library import Error, place, public
from .files import Dataset, Weights, _open, _text

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .files import Numbers, Path
    Data = typing.Union[Path, typing.Sequence[Path]]

UNFIT = 13  # exit code: the fit ended, and is worse than persistence
VIOLATED = 10  # exit code: the evaluation ended, and a law was violated


def _run(*arguments: Path, progress: bool = False, codes: tuple[int, ...] = (0,)) -> tuple[int, str]:
    """Runs portmet-train and returns its exit code and output. Raises Error if it was refused, or was
    stopped. `progress` shows each line as it comes, and bars between them, in a terminal or a notebook."""
    command = [place("PORTMET_TRAIN", _places.TRAINER, "portmet-train"), *(os.fspath(word) for word in arguments)]
    lines: list[str] = []
    refused: list[str] = []
    width = 0  # of the bar that is shown

    def show(text: str, bar: bool = False) -> None:
        nonlocal width
        if progress:
            sys.stdout.write("\r" + " " * width + "\r" + text if width else text)
            sys.stdout.flush()
            width = len(text) if bar else 0

    def read_errors(errors: typing.Iterable[str]) -> None:
        for line in errors:  # a bar begins with a carriage return, which ends a line here, too
            if line.endswith("\033[K\n"):
                show(line[:-4], bar=True)
            else:
                refused.append(line)

    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          env={**os.environ, "PORTMET_PROGRESS": "1"} if progress else None) as process:
        assert process.stdout is not None and process.stderr is not None
        reader = threading.Thread(target=read_errors, args=(process.stderr,))
        reader.start()
        try:
            for line in process.stdout:
                lines.append(line)
                show(line)
        except KeyboardInterrupt:
            process.terminate()  # it keeps what it has
            raise
        finally:
            process.wait()
            reader.join()
    show("")
    if process.returncode not in codes:
        raise Error(process.returncode, "".join(refused).strip())
    return process.returncode, "".join(lines)


def _options(options: dict[str, typing.Any]) -> list[str]:
    """Turns validation="0:4", resume=True into --validation 0:4 --resume."""
    result = []
    for name, value in options.items():
        if value is not None and value is not False:
            result.append("--" + name.replace("_", "-"))
            several = value if isinstance(value, (list, tuple)) else [value]
            result += [] if value is True else [os.fspath(v) if isinstance(v, os.PathLike) else str(v) for v in several]
    return result


def _is_interactive() -> bool:
    """Whether somebody looks: in a notebook, or at a terminal."""
    return "ipykernel" in sys.modules or bool(getattr(sys.stdout, "isatty", bool)())


@public
class Fit:
    """The result of `fit`: the `folder` of the weights, the printed `report`, whether the model
    `fits`, its `verdict` ("good", "fair", "poor" or "UNFIT") with the `reasons` why it is not good,
    and the `errors` of the report's table."""

    def __init__(self, folder: str, report: str, fits: bool) -> None:
        self.folder, self.report, self.fits = folder, report, fits
        said = re.search(r"^Verdict: ([^.\n]*)\. ?(.*)(?:\n  Not good, since (.*)\.)?", report, re.MULTILINE)
        self.verdict = said[1] if said else ""
        self.reasons = [] if said is None else said[3].split("; ") if said[3] else [] if fits else [said[2]]

    @property
    def history(self) -> typing.Any:
        """The losses: a record array with a record for each line of fit.csv."""
        return numpy.genfromtxt(os.path.join(self.folder, "fit.csv"), delimiter=",", names=True,
                                dtype=None, encoding="utf-8")

    @property
    def weights(self) -> dict[str, str]:
        """The weights files by the name of their subsystem or port."""
        own = (os.path.join(self.folder, name) for name in sorted(os.listdir(self.folder)) if name.endswith(".h5"))
        return {os.path.basename(path)[:-3]: path for path in own if _is_weights(path)}

    @property
    def constants(self) -> dict[str, dict[str, float]]:
        """The learned constants of each subsystem and port that has some."""
        all_ = {name: Weights(path).constants for name, path in self.weights.items()}
        return {name: constants for name, constants in all_.items() if constants}

    @property
    def errors(self) -> dict[str, dict[str, float]]:
        """Relative errors, 0.01 for 1 %, by the row of the report, "upper q": for complete states
        "training", "validation" (medians of rollouts), "persistence" and "black box"; for measurements
        "median" and "largest" of each column's deviation, "left out" and "black box". What the report
        does not have is NaN or missing."""
        table = re.search(r"^Errors, %(.*)\n  part, group(.*)\n((?:  .*\n)*)", self.report, re.MULTILINE)
        if table:
            both, columns = "valid." in table[2], table[2].split()
            at = {"training": columns.index("median"), "persistence": len(columns) - 1 - ("black box" in table[1])}
            if both:
                at["validation"] = at["training"] + 3
            if "black box" in table[1]:
                at["black box"] = len(columns) - 1
            rows, names = table[3].splitlines(), 2
        else:
            table = re.search(r"^Starts of the .*\n  column .*\n((?:  .*\n)*)", self.report, re.MULTILINE)
            rows, names = (table[1].splitlines() if table else []), 1
            at = {"median": 0, "largest": 1, "left out": 2, "black box": 3}
        result = {}
        for row in rows:
            words = row.split()
            values = [numpy.nan if word == "-" else float(word) / 100 for word in words[names:]]
            result[" ".join(words[:names])] = {key: values[i] for key, i in at.items()}
        return result

    def plot(self, path: Path | None = None) -> Figure:
        """Draws the losses over the time of training with matplotlib, and returns the figure. With
        `path` it also saves the figure."""
        from .plot import losses

        return losses(self.history, path)

    def __repr__(self) -> str:
        return f"<portmet fit in {self.folder}: {self.verdict or 'not judged'}>"


def _is_weights(path: str) -> bool:
    try:
        Weights(path)
    except Error:
        return False
    return True


@public
class Evaluation:
    """The result of `evaluate`. `truth` and `prediction` are arrays [trajectory][time][column] with
    the names `columns`, for the numbers `trajectories` of the data; `t` are the times in s. `errors`
    maps each group of variables to the relative L2 errors [trajectory] of its rollouts; `scores` is
    the JSON of `portmet-train evaluate --json`, with laws and thermodynamic quantities. `violates`:
    a component that keeps a law by construction violates it."""

    def __init__(self, scores: dict[str, typing.Any], truth: Dataset, prediction: Dataset, violates: bool) -> None:
        self.scores, self.violates, self.columns = scores, violates, prediction.columns
        rollouts = scores["rollouts"]
        self.trajectories: list[int] = [r["trajectory"] for r in rollouts]
        self.seen: list[bool | None] = [r["seen"] for r in rollouts]
        self.t, self.prediction = prediction.t, prediction.z
        self.truth: Numbers = numpy.stack([truth[name][self.trajectories, :len(self.t)] for name in self.columns], axis=2)
        self.errors: dict[str, Numbers] = {
            group: numpy.array([numpy.nan if r["error"][group] is None else r["error"][group] for r in rollouts])
            for group in scores["groups"]}

    def plot(self, path: Path | None = None, trajectory: int = 0) -> Figure:
        """Draws one trajectory, the truth and the prediction of every column, and returns the figure.
        `trajectory` counts those that were evaluated."""
        from .plot import rollout

        return rollout(self, trajectory, path)

    def __str__(self) -> str:
        rows = [f"{'group':12} {'median, %':>10} {'largest, %':>10} {'persistence, %':>14}"]
        for group, errors in self.errors.items():
            persistence = self.scores["groups"][group]["persistence"]
            rows.append(f"{group:12} {100 * numpy.median(errors):10.3g} {100 * errors.max():10.3g} {100 * persistence:14.3g}")
        laws = self.scores["laws"]
        if laws:
            rows.append(f"steps in violation: {laws['violations']} of {laws['steps']}; the energy drifts by "
                        f"{laws['energy_drift']:.3g} J at most, the entropy falls by {laws['entropy_fall']:.3g} J/K at most")
        return "\n".join(rows)

    def __repr__(self) -> str:
        return f"<portmet evaluation of {self.scores['scene']}: {len(self.trajectories)} trajectories>\n{self}"


@public
class Estimate:
    """The result of `evaluate` with `estimate`: predictions of measurements, from starts that the first `seconds`
    of each trajectory tell. `truth` and `prediction` are arrays [trajectory][time][column] with the names
    `columns`, at the times `t` [trajectory][time] in s, for the numbers `trajectories` of the data; NaN is where
    nothing was measured, or predicted. `states` [trajectory][time][component] has all variables, with the names
    `components`. `deviation` and `state_deviation` have the standard deviations of both; None: the weights do not
    tell them. `errors` maps each column to its errors [trajectory] after the start, relative to the deviation of
    the whole trajectory, and `residuals` to what the start leaves. `scores` is the JSON of `portmet-train
    evaluate --estimate --json`. `violates`: as in Evaluation."""

    def __init__(self, scores: dict[str, typing.Any], record: Path, truth: Numbers, violates: bool) -> None:
        self.scores, self.violates, self.seconds = scores, violates, float(scores["estimate"])
        self.trajectories: list[int] = scores["trajectories"]
        with _open(record, "a record of predictions") as f:
            self.columns, self.components = ([_text(name) for name in f.attrs[key]] for key in ("columns", "components"))
            self.t: Numbers = f["t"][:]
            self.prediction: Numbers = f["y"][:]
            self.states: Numbers = f["z"][:]
            self.deviation: Numbers | None = f["deviation"][:] if "deviation" in f else None
            self.state_deviation: Numbers | None = f["state_deviation"][:] if "deviation" in f else None
        self.truth: Numbers = truth[self.trajectories]
        self.errors: dict[str, Numbers] = {
            name: numpy.array(column["error"], dtype=float) for name, column in scores["columns"].items()}
        self.residuals: dict[str, float] = {name: column["residual"] for name, column in scores["columns"].items()}

    def plot(self, path: Path | None = None, trajectory: int = 0) -> Figure:
        """Draws one trajectory as that of an Evaluation, with bands that nine of ten measurements lie inside."""
        from .plot import rollout

        return rollout(self, trajectory, path)

    def __str__(self) -> str:
        rows = [f"{'column':12} {'median, %':>10} {'largest, %':>10} {'residual':>10}"]
        for name, errors in self.errors.items():
            rows.append(f"{name:12} {100 * numpy.nanmedian(errors):10.3g} {100 * numpy.nanmax(errors):10.3g} "
                        f"{self.residuals[name]:10.3g}")
        return "\n".join(rows)

    def __repr__(self) -> str:
        return f"<portmet predictions of {len(self.trajectories)} trajectories from their first {self.seconds:g} s>\n{self}"


@public
def fit(config: Path, output: Path, *, data: Data | None = None, progress: bool | None = None,
        **options: typing.Any) -> Fit:
    """Trains the models of a training file, or of a scene with a proposal, as `portmet-train fit` does,
    and writes their weights to the folder `output`. `progress` shows each line as it comes; None: in a
    notebook or a terminal. The other options are those of the command, with underscores:
    trajectories="0:40", validation="none", resume=True."""
    code, report = _run("fit", config, "-o", output, *_options({"data": data, **options}), codes=(0, UNFIT),
                        progress=_is_interactive() if progress is None else progress)
    return Fit(os.path.abspath(os.fspath(output)), report, code == 0)


@public
class Proposal:
    """What `propose` has written: the paths of the `scene` and of the `training` file, and the printed `report`. It
    stands for the training file: fit(propose(...), folder)."""

    def __init__(self, scene: Path | None, report: str) -> None:
        written: list[str] = re.findall(r"^wrote (.*\.yaml)$", report, re.MULTILINE)
        self.report = report
        self.scene = os.fspath(scene) if scene is not None else written[0]
        self.training = written[-1]

    def __fspath__(self) -> str:
        return self.training

    def __str__(self) -> str:
        return self.report

    def __repr__(self) -> str:
        return f"<portmet proposal {self.training}>"


@public
def propose(scene: Path | None = None, data: Data | None = None, output: Path | None = None, *,
            progress: bool | None = None, **options: typing.Any) -> Proposal:
    """Writes a draft of a training file for a scene and its data, or, without a scene, a scene and a
    training file for tables. `progress` and other options are those of `fit` and of the command."""
    _, report = _run("propose", *([] if scene is None else [scene]),
                     *_options({"data": data, "output": output, **options}),
                     progress=_is_interactive() if progress is None else progress)
    return Proposal(scene, report)


@typing.overload
def evaluate(scene: Path, *, data: Data, estimate: None = None, **options: typing.Any) -> Evaluation: ...


@typing.overload
def evaluate(scene: Path, *, data: Data, estimate: float, **options: typing.Any) -> Estimate: ...


@public
def evaluate(scene: Path, *, data: Data, estimate: float | None = None, **options: typing.Any) -> Evaluation | Estimate:
    """Predicts the trajectories of a dataset and returns an Evaluation. With `estimate`, for measurements,
    the start is what the first `estimate` seconds tell, and the result an Estimate. The other options are
    those of the command, with underscores."""
    with tempfile.TemporaryDirectory() as folder:
        several = data if isinstance(data, (list, tuple)) else [data]
        given = several[0]
        try:
            truth = Dataset(given if len(several) == 1 else "")
        except Error:  # tables
            given = os.path.join(folder, "data.h5")
            import_tables(data, given)
            truth = Dataset(given)
        record = options.pop("record", None) or os.path.join(folder, "prediction.h5")
        code, text = _run("evaluate", scene, *_options({"data": given, "json": True, "record": record,
                                                        "estimate": estimate, **options}), codes=(0, VIOLATED))
        if estimate is None:
            return Evaluation(json.loads(text), truth, Dataset(record), code == VIOLATED)
        with _open(given, "a dataset") as f:
            return Estimate(json.loads(text), record, f[options.get("data_set") or "z"][:], code == VIOLATED)


@public
def import_tables(tables: Data, output: Path, **options: typing.Any) -> str:
    """Turns tables, a path or a list of paths, into a dataset, as `portmet-train import` does."""
    several = tables if isinstance(tables, (list, tuple)) else [tables]
    return _run("import", *several, *_options({"output": output, **options}))[1]
