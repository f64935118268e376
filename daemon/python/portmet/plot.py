"""A picture of a recording, with matplotlib where it is installed."""


def _sum(series):
    """The sum over the members of a range, or the series of a single component itself."""
    return series.reshape(len(series), -1).sum(axis=1)


def plot(recording, path=None):
    """Draws energies, entropies and the power through every port over time, and returns the figure.
    Members of a range are drawn as their sum. With `path` it also saves the figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 9), layout="constrained")
    energy, entropy, power = figure.subplots(3, sharex=True)
    for name, values in recording.subsystems.items():
        energy.plot(recording.time, _sum(values["E"]), label=name)
        entropy.plot(recording.time, _sum(values["S"]), label=name)
    energy.plot(recording.time, recording.ledger["energy"], "k--", label="total")
    entropy.plot(recording.time, recording.ledger["entropy"], "k--", label="total")
    for name, values in recording.ports.items():
        power.plot(recording.time, _sum(values["energy_flux_a"]), label=name + ", into a")
    for axes, label in ((energy, "energy in J"), (entropy, "entropy in J/K"), (power, "power in W")):
        axes.set_ylabel(label)
        axes.grid(True)
        if axes.lines:
            axes.legend(fontsize="small")
    power.set_xlabel("time in s")
    if path is not None:
        figure.savefig(path)
    return figure
