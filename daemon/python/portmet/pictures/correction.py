# SPDX-License-Identifier: MIT
"""Corrects the fields of a simulation by a few better known fields of the same body under the same loads. The
discrepancy between both varies smoothly with the place of the load, even where the fields themselves do not.

The place of a load is the mean position of its forces at the last time, weighted by their size. Consider two known loads
whose places differ in x alone and whose total forces have the same history, and a simulated load between them, at the
fraction w of the distance from the first to the second. Its correction is interpolated linearly; beyond the last known
load the correction is constant:

    z = simulated + (1 - w) (known_0 - simulated_0) + w (known_1 - simulated_1)

(A simulation at two levels and their discrepancy: Kennedy, O'Hagan, Biometrika 87, 2000; the discrepancy is interpolated
here instead of regressed.)"""
import os

import h5py
import numpy

import xdmf
from gnuplot import Refused
from portmet_files import text

DATA = 5  # exit code
SAME = 1e-5  # relative to the size of the body or of a force: single precision
SAME_TOTAL = 1e-3  # relative to a total force


class Field:
    """z [trajectory][time][node][variable], forces f [trajectory][time][node][3] in N, nodes x [node][3] in m."""

    def __init__(self, path):
        with h5py.File(path, "r") as file:
            self.z, self.f = file["z"][()].astype(float), file["f"][()].astype(float)
            self.t, self.dt, self.x = file["t"][()], float(file["dt"][()]), file["node_position_reference"][()].astype(float)
            self.bricks = file["hexahedra"][()] if "hexahedra" in file else numpy.zeros((0, 8))
            self.variables = " ".join(text(file.attrs["state_layout"]).split()[:self.z.shape[3]])
        if self.f.shape[1] == len(self.t) - 1:  # without the first time
            self.f = numpy.concatenate((numpy.zeros_like(self.f[:, :1]), self.f), axis=1)

    def place(self, i, whose):
        size = numpy.linalg.norm(self.f[i, -1], axis=1)
        if not size.sum() > 0:
            raise Refused(DATA, f"trajectory {i} of {whose} has no load at its last time, so the load has no place")
        return size @ self.x / size.sum()


def at(x):
    return "({:g}, {:g}, {:g}) m".format(*x)


def renumber(own, known, near):
    """Takes the nodes, elements and numbering of the known fields for the simulated ones."""
    order = []
    for x in known.x:
        close = numpy.flatnonzero((numpy.abs(own.x - x) <= near).all(axis=1))
        if not len(close):
            raise Refused(DATA, f"the simulation has no node at {at(x)}")
        order.append(close[0])
    own.z, own.f, own.x = own.z[:, :, order], own.f[:, :, order], known.x


def differ(a, b):
    """The relative difference of the forces of a simulated and a known trajectory."""
    off = ((a - b) ** 2).sum()
    return 0 if off == 0 else numpy.sqrt(off / (b ** 2).sum()) if b.any() else numpy.inf


def correct(own, known, which):
    """Corrects all trajectories of `own` by those of `known` whose numbers are `which`. Each of the known loads must also
    be among the simulated ones. Each simulated load must lie on a line along x with a known one of the same size and
    direction."""
    if own.z.shape[1:3] != known.z.shape[1:3] or abs(own.dt - known.dt) > SAME * known.dt:
        raise Refused(DATA, f"the simulation has {own.z.shape[2]} nodes at {own.z.shape[1]} times {own.dt:g} s apart, the known "
                            f"fields have {known.z.shape[2]} at {known.z.shape[1]}, {known.dt:g} s apart")
    if own.variables != known.variables:
        raise Refused(DATA, f'the simulation has the variables "{own.variables}", the known fields "{known.variables}"')
    near = SAME * numpy.abs(known.x).max()
    renumber(own, known, near)
    places = [own.place(i, "the simulation") for i in range(len(own.z))]
    better = [known.place(k, "the known fields") for k in which]
    totals, better_totals = own.f.sum(axis=2), known.f.sum(axis=2)
    discrepancy = []
    for k, x in zip(which, better):
        same = [i for i, p in enumerate(places) if (abs(p - x) <= near).all() and differ(own.f[i], known.f[k]) <= SAME]
        if not same:
            raise Refused(DATA, f"the simulation has no load like that of trajectory {k} of the known fields, at {at(x)}")
        discrepancy.append(known.z[k] - own.z[same[0]])
    for i, p in enumerate(places):
        row = [n for n, (k, x) in enumerate(zip(which, better))
               if (abs(x - p)[1:] <= near).all() and differ(totals[i], better_totals[k]) <= SAME_TOTAL]
        low = [n for n in row if p[0] - better[n][0] >= -near]
        high = [n for n in row if better[n][0] - p[0] >= -near]
        if not low + high:
            raise Refused(DATA, "no known load of the same size and direction lies in a row with that of trajectory "
                                f"{i} of the simulation, at {at(p)}")
        first = max(low or high, key=lambda n: better[n][0] * (1 if low else -1))
        second = min(high or low, key=lambda n: better[n][0] * (1 if high else -1))
        length = better[second][0] - better[first][0]
        w = (p[0] - better[first][0]) / length if length > near else 0
        own.z[i] += (1 - w) * discrepancy[first] + w * discrepancy[second]


def run(output, command, which, simulated, better):
    """Corrects the file `simulated` by the trajectories `which` of the file `better`."""
    own, known = Field(simulated), Field(better)
    correct(own, known, [int(k) for k in which.split(",")])
    temporary = f"{output}.{os.getpid()}.tmp"
    try:
        with h5py.File(temporary, "x") as file:
            for name, value in (("title", "Fields of a simulation, corrected by better known ones"),
                                ("source", "portmet-train correct"), ("command", command), ("state_layout", own.variables)):
                file.attrs[name] = numpy.bytes_(value)
            file["dt"], file["t"], file["z"], file["f"] = known.dt, known.t, own.z, own.f
            file["node_position_reference"] = own.x
            if len(known.bricks):
                file["hexahedra"] = known.bricks
        os.rename(temporary, output)
    finally:
        if os.path.exists(temporary):
            os.unlink(temporary)
    if len(known.bricks):
        xdmf.describe(output)
    print(f"wrote {output}: {own.z.shape[0]} trajectories of {own.z.shape[1]} states, {own.z.shape[2]} nodes")
