"""Drives the trainer, portmet-train (trainer/README.md). `data` is a dataset, a table, or a list of tables."""
import os
import subprocess

import numpy

from . import _places
from ._library import Error, place

UNFIT = 13  # exit code: the fit ended, and is worse than persistence


def _run(*arguments):
    """Runs portmet-train and returns its exit code and output. Raises Error if it was refused."""
    command = [place("PORTMET_TRAIN", _places.TRAINER, "portmet-train"), *map(os.fspath, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, UNFIT):
        raise Error(done.returncode, done.stderr.strip())
    return done.returncode, done.stdout


def _options(options):
    """Turns validation="0:4", resume=True into --validation 0:4 --resume."""
    result = []
    for name, value in options.items():
        if value is not None and value is not False:
            result.append("--" + name.replace("_", "-"))
            several = value if isinstance(value, (list, tuple)) else [value]
            result += [] if value is True else [os.fspath(v) if isinstance(v, os.PathLike) else str(v) for v in several]
    return result


class Fit:
    """The result of `fit`: the `folder` of the weights, the `history` of the losses (one record for each
    line of fit.csv), the printed `report`, and whether the model `fits`."""

    def __init__(self, folder, report, fits):
        self.folder, self.report, self.fits = folder, report, fits

    @property
    def history(self):
        return numpy.genfromtxt(os.path.join(self.folder, "fit.csv"), delimiter=",", names=True,
                                dtype=None, encoding="utf-8")

    @property
    def weights(self):
        """The weights files by the name of their subsystem or port."""
        return {name[:-3]: os.path.join(self.folder, name)
                for name in sorted(os.listdir(self.folder)) if name.endswith(".h5")}

    def __repr__(self):
        return f"<portmet fit in {self.folder}{'' if self.fits else ', which is unfit'}>"


def fit(config, output, *, data=None, **options):
    """Trains the models of a training file, or of a scene with a proposal, as `portmet-train fit` does,
    and writes their weights to the folder `output`. The other options are those of the command, with
    underscores: trajectories="0:40", validation="none", resume=True."""
    code, report = _run("fit", config, "-o", output, *_options({"data": data, **options}))
    return Fit(os.fspath(output), report, code == 0)


def propose(scene, data, output, **options):
    """Writes a draft of a training file for a scene and its data."""
    return _run("propose", scene, *_options({"data": data, "output": output, **options}))[1]


def evaluate(scene, *, data, **options):
    """Predicts the trajectories of a dataset and returns the printed scores."""
    return _run("evaluate", scene, *_options({"data": data, **options}))[1]


def import_tables(tables, output, **options):
    """Turns tables, a path or a list of paths, into a dataset, as `portmet-train import` does."""
    tables = tables if isinstance(tables, (list, tuple)) else [tables]
    return _run("import", *tables, *_options({"output": output, **options}))[1]
