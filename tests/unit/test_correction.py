#!/usr/bin/env python3
"""test_correction.py PACKAGE: corrects a simulation by better known fields. An error that is linear in the place of the
load is removed entirely, whatever the numbering of the nodes."""
import os
import sys

try:
    import h5py  # noqa: F401
    import numpy as np
except ImportError:
    if sys.executable != "/usr/bin/python3" and os.path.exists("/usr/bin/python3"):
        os.execv("/usr/bin/python3", ["/usr/bin/python3", *sys.argv])
    print("skipped: no Python 3 with h5py (Debian: python3-h5py)")
    sys.exit(77)

sys.path[:0] = [f"{sys.argv[1]}/pictures", f"{sys.argv[1]}/tables"]
import correction  # noqa: E402
from gnuplot import Refused  # noqa: E402

NROW, NTIME, USED = 5, 3, [2, 0]
J = np.arange(NTIME)[:, None]


class Field(correction.Field):
    """Nodes in two rows along x, at y = 0 and 1, in this order or in the reverse."""

    def __init__(self, ntrajectory, reverse):
        nodes = np.arange(2 * NROW)[::-1 if reverse else 1]
        self.x = np.stack((nodes % NROW, nodes // NROW, 0 * nodes), axis=1).astype(float)
        self.z, self.f = np.zeros((ntrajectory, NTIME, 2 * NROW, 2)), np.zeros((ntrajectory, NTIME, 2 * NROW, 3))
        self.dt, self.variables = 0.5, "q v"

    def press(self, i, x, y, error):
        """A load at x in row y and the response to it: an arbitrary one, and an error that is linear in x."""
        at = self.x[:, 0], self.x[:, 1]
        self.z[i, :, :, 0] = J * np.sin(3 * at[0] * x + at[1]) + error * (1 + 2 * x) * (J + at[0] - 3 * at[1])
        self.z[i, :, :, 1] = J * np.cos(at[0] + x) + error * (4 - x)
        self.f[i, :, :, 1] = np.where((at[0] == x) & (at[1] == y), -7.0 * J, 0)


def pair():
    """The simulated loads lie at x = 0 .. 4 of the first row. Two of the three known loads are used, at 1 and 3, on nodes
    in another order."""
    own, known = Field(NROW, False), Field(3, True)
    for i in range(NROW):
        own.press(i, i, 0, 0.1)
    for i, (x, error) in enumerate(((3, 0), (2, 5), (1, 0))):
        known.press(i, x, 0, error)
    return own, known


def refuse(words, spoil):
    own, known = pair()
    spoil(own, known)
    try:
        correction.correct(own, known, USED)
    except Refused as refused:
        assert refused.code == 5 and words in str(refused), f'"{refused}", expected "{words}"'
        return
    raise AssertionError(f'expected "{words}"')


own, known = pair()
correction.correct(own, known, USED)
right = Field(NROW, True)
assert (own.x == known.x).all()
for i in range(NROW):  # beyond the last known loads the discrepancy is constant
    nearest = min(max(i, 1), 3)
    lost, none = Field(1, True), Field(1, True)
    right.press(i, i, 0, 0.1)
    lost.press(0, nearest, 0, 0.1)
    none.press(0, nearest, 0, 0)
    off = np.abs(own.z[i] - (right.z[i] - lost.z[0] + none.z[0])).max()
    assert off < 1e-13, f"load {i}: {off} off"
assert (own.f == right.f).all()


def set_force(field, i, j, value):
    field.f[i, j] = value


def twice(own, _):  # between the known ones, but twice as strong
    own.f[2] *= 2


refuse("no load like that of trajectory 0 of the known fields, at (3, 0, 0) m", lambda own, _: own.press(3, 3, 1, 0))
refuse("in a row with that of trajectory 4 of the simulation, at (4, 1, 0) m", lambda own, _: own.press(4, 4, 1, 0))
refuse("no load like that of trajectory 2", lambda own, _: own.f.__setitem__((1, 1, 1, 0), 1))  # the same place, other forces
refuse("same size and direction lies in a row with that of trajectory 2", twice)
refuse("trajectory 2 of the simulation has no load at its last time", lambda own, _: set_force(own, 2, -1, 0))
refuse("trajectory 2 of the known fields has no load at its last time", lambda _, known: set_force(known, 2, -1, 0))
refuse("the simulation has no node at (0, 0, 0) m", lambda own, _: own.x.__setitem__((0, 0), 0.5))
refuse('variables "q w", the known fields "q v"', lambda own, _: setattr(own, "variables", "q w"))
refuse("0.6 s apart", lambda own, _: setattr(own, "dt", 0.6))
