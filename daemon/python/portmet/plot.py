# SPDX-License-Identifier: MIT
"""Pictures of recordings, fits and evaluations, with matplotlib where it is installed."""
from __future__ import annotations

import typing

from ._library import public

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .files import Numbers, Path, Recording
    from .train import Estimate, Evaluation

NINETY_PER_CENT = 1.6448536269514722  # deviations of a normal distribution


def _figure(rows: int, height: float) -> typing.Any:
    """A figure with its rows of axes over one time. A notebook shows it as the value of a cell."""
    from matplotlib.figure import Figure

    class Shown(Figure):
        def _repr_png_(self) -> bytes:
            import io

            image = io.BytesIO()
            self.savefig(image, format="png")
            return image.getvalue()

    figure = Shown(figsize=(8, height), layout="constrained")
    axes = figure.subplots(rows, sharex=True, squeeze=False)[:, 0]
    for one in axes:
        one.grid(True)
    return figure, axes


def _finish(figure: Figure, axes: typing.Any, path: Path | None) -> Figure:
    for one in axes:
        if len(one.lines) <= 12 and any(not line.get_label().startswith("_") for line in one.lines):
            one.legend(fontsize="small")
    if path is not None:
        figure.savefig(path)
    return figure


def _sum(series: Numbers) -> Numbers:
    """The sum over the members of a range, or the series of a single component itself."""
    result: Numbers = series.reshape(len(series), -1).sum(axis=1)
    return result


@public
def plot(recording: Recording, path: Path | None = None) -> Figure:
    """Draws energies, entropies and the power through every port over time, and returns the figure.
    Members of a range are drawn as their sum. With `path` it also saves the figure."""
    figure, axes = _figure(3, 9)
    energy, entropy, power = axes
    for name, values in recording.subsystems.items():
        energy.plot(recording.time, _sum(values["E"]), label=name)
        entropy.plot(recording.time, _sum(values["S"]), label=name)
    energy.plot(recording.time, recording.ledger["energy"], "k--", label="total")
    entropy.plot(recording.time, recording.ledger["entropy"], "k--", label="total")
    for name, values in recording.ports.items():
        power.plot(recording.time, _sum(values["energy_flux_a"]), label=name + ", into a")
    for one, label in ((energy, "energy in J"), (entropy, "entropy in J/K"), (power, "power in W")):
        one.set_ylabel(label)
    power.set_xlabel("time in s")
    return _finish(figure, axes, path)


def losses(history: typing.Any, path: Path | None = None) -> Figure:
    """Draws the losses of a fit, each stage with a line of its own."""
    figure, axes = _figure(1, 4)
    axes[0].set_yscale("log")
    for stage in sorted(set(history["stage"])):
        rows = history[history["stage"] == stage]
        axes[0].plot(rows["seconds"], rows["loss"], label=f"loss, stage {stage} ({rows['optimiser'][0]})")
    if "validation" in history.dtype.names and history["validation"].dtype.kind == "f":
        axes[0].plot(history["seconds"], history["validation"], "ko", label="validation, relative to persistence")
    axes[0].set_xlabel("time of training in s")
    return _finish(figure, axes, path)


def rollout(result: Evaluation | Estimate, trajectory: int = 0, path: Path | None = None) -> Figure:
    """Draws the truth and the prediction of every column of one trajectory, with bands where there are some."""
    figure, axes = _figure(len(result.columns), 1 + 1.5 * len(result.columns))
    t, deviation = result.t if result.t.ndim == 1 else result.t[trajectory], getattr(result, "deviation", None)
    for c, (one, name) in enumerate(zip(axes, result.columns)):
        prediction = result.prediction[trajectory, :, c]
        one.plot(t, result.truth[trajectory, :, c], color="0.6", linewidth=3, label="truth")
        one.plot(t, prediction, label="prediction")
        if deviation is not None:
            width = NINETY_PER_CENT * deviation[trajectory, :, c]
            one.fill_between(t, prediction - width, prediction + width, alpha=0.3, label="90 %")
        one.set_ylabel(name)
    axes[-1].set_xlabel("time in s")
    return _finish(figure, axes, path)
