# SPDX-License-Identifier: MIT
"""Draws the deformed surfaces of bodies, coloured by von Mises stress. gnuplot sorts the faces by depth."""
import argparse
import math
import os

import h5py
import numpy

from portmet_files import text
from gnuplot import Refused, quoted, run

USAGE, FILE, DATA = 2, 4, 5  # exit codes
KILO = 1e3  # the colours show kPa
PANEL_HEIGHT = 440  # pixels
FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # of a brick, as VTK counts
PALETTE = "'#440154', 1 '#414487', 2 '#2a788e', 3 '#22a884', 4 '#7ad151', 5 '#fde725'"


class Body:
    """A body of a field file at one time: nodes in the body's frame and in that of its placement, stress, faces."""

    def __init__(self, path, trajectory, time):
        self.path, self.trajectory = path, trajectory
        try:
            with h5py.File(path, "r") as file:
                names = text(file.attrs["state_layout"]).split()
                z, t = file["z"], file["t"][()]
                if z.ndim != 4:
                    raise Refused(DATA, f"{path}: /z has {z.ndim} dimensions, expected those of trajectories, times, nodes, variables")
                if "hexahedra" not in file or "sxx" not in names:
                    raise Refused(DATA, f"{path}: the field has no mesh of hexahedra, or no stress to colour it by")
                if trajectory >= len(z):
                    raise Refused(DATA, f"{path}: there is no trajectory {trajectory}, only {len(z)} of them")
                self.time = t[-1] if time is None else t[numpy.abs(t - time).argmin()]
                state = z[trajectory, int(numpy.flatnonzero(t == self.time)[0])]
                q, stress = names.index("qx") if "qx" in names else -1, names.index("sxx")
                self.own = state[:, q:q + 3] if q >= 0 else file["node_position_reference"][()]
                self.stress = state[:, stress:stress + 6]
                bricks = file["hexahedra"][()].astype(int)
                self.placement = text(file.attrs.get("placement", ""))
        except (OSError, KeyError, ValueError) as error:
            raise Refused(FILE, f"{path}: cannot be read as a field: {error}") from None
        faces = bricks[:, FACES].reshape(-1, 4)  # those of one brick alone
        _, first, count = numpy.unique(numpy.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        self.faces = faces[numpy.sort(first[count == 1])]

    def place(self, together):
        """Takes the positions in the picture: in the frame of all bodies, or in the body's own. A placement is written
        as `origin: [36, -26, 11], axes: [+y, -x, +z]` (trainer/bodies/field/field.h)."""
        self.at = self.own
        if together:
            origin, axes = (part.split("[")[1].split(",") for part in self.placement.split("]")[:2])
            self.at = numpy.tile([float(x) for x in origin], (len(self.own), 1))
            for d, axis in enumerate(axis.strip() for axis in axes):
                self.at[:, "xyz".index(axis[1])] += (1 if axis[0] == "+" else -1) * self.own[:, d]


def von_mises(s):
    x, y, z = s[:, 0] - s[:, 1], s[:, 1] - s[:, 2], s[:, 2] - s[:, 0]
    return numpy.sqrt((x * x + y * y + z * z) / 2 + 3 * (s[:, 3:] ** 2).sum(axis=1)) / KILO


def panel(bodies, colours, title, named):
    """A quadrangle is a grid of two by two points. Two empty lines separate it from the next."""
    text = "$surface << END\n"
    for body, values in zip(bodies, colours):
        for face in body.faces:
            for k, node in enumerate(face[[0, 1, 3, 2]]):
                x, y, z = body.at[node]
                text += f"{x:.5g} {y:.5g} {z:.5g} {values[node]:.4g}\n" + ("", "\n", "", "\n\n")[k]
    names = "".join(f"{'.' if i == 0 else '.' + quoted(', ') + '.'}{quoted(body.path)}" for i, body in enumerate(bodies))
    return (f"{text}END\nset title {quoted(title)}{names if named else ''}.' trajectory {bodies[0].trajectory}, "
            f"{bodies[0].time:.4g} s' noenhanced\nsplot $surface using 1:2:3:4 with pm3d\n")


def panels_of(bodies, nbeside):
    """Bodies that are placed share a panel, but those beside have one of their own."""
    together = all(body.placement for body in bodies)
    panels = []
    for i, body in enumerate(bodies):
        body.place(together)
        if i == 0 or not together or i == len(bodies) - nbeside:
            panels.append([])
        panels[-1].append(body)
    return panels


def read_options(words):
    def positive(name, given, kind, expected):
        try:
            value = kind(given)
            assert math.isfinite(value)
            return value
        except (ValueError, AssertionError):
            raise Refused(USAGE, f'picture: {name} "{given}": expected {expected}') from None

    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("field", nargs="+")
    parser.add_argument("--output", "-o")
    for name in "--beside", "--trajectory", "--time":
        parser.add_argument(name)
    parser.add_argument("--error", action="store_true")
    how = parser.parse_intermixed_args(words)
    how.beside = how.beside.split(",") if how.beside else []
    given, expected = how.trajectory, "a whole number" + (", or two joined by a comma" if how.beside else "")
    parts = "0" if given is None else given.split(",")
    if len(parts) > (2 if how.beside else 1) or not all(part.isdigit() for part in parts):
        raise Refused(USAGE, f'picture: --trajectory "{given}": expected {expected}')
    how.trajectory = [int(part) for part in parts]
    how.time = None if how.time is None else positive("--time", how.time, float, "a number")
    return how


def draw(*words):
    how = read_options(words)
    script = os.path.splitext(how.output)[0] + ".gp"
    if script == how.output:
        raise Refused(USAGE, f"{script}: the script of the picture has this name; choose another one")
    for field in how.field + how.beside:
        if os.path.exists(field) and not os.path.isfile(field):
            raise Refused(FILE, f"{field}: this is not a regular file, and is not read")
    bodies = [Body(path, how.trajectory[0], how.time) for path in how.field]
    if how.time is None:
        how.time = bodies[0].time
        bodies = bodies[:1] + [Body(path, how.trajectory[0], how.time) for path in how.field[1:]]
    bodies += [Body(path, how.trajectory[-1], how.time) for path in how.beside]
    panels = panels_of(bodies, len(how.beside))
    if how.error and not (len(panels) == 2 and [len(b.at) for b in panels[0]] == [len(b.at) for b in panels[1]]):
        raise Refused(USAGE, "picture: --error: expected two fields of one body, or --beside with a field of each body")
    colours = [[von_mises(body.stress) for body in p] for p in panels]
    text = []
    highest = max(values.max() for p in colours for values in p)
    for i, (p, values) in enumerate(zip(panels, colours)):
        text.append(panel(p, values, "", len(panels) > 1) + ("unset colorbox\n" if i == 0 else ""))
    if how.error:  # the bodies of the second panel, coloured by the difference, on a scale of its own
        off = [von_mises(b.stress - a.stress) for a, b in zip(*panels)]
        text.append(f"set cbrange [0:{max(max(values.max() for values in off), 1e-300):.4g}]\nset cblabel 'error, kPa'\n"
                    "set colorbox user origin 0.88, 0.06 size 0.02, 0.24\n" + panel(panels[1], off, "error,", False))
    positions = numpy.concatenate([body.at for body in bodies])
    ranges = "".join(f"set {axis}range [{low:.6g}:{high:.6g}]\n"
                     for axis, low, high in zip("xyz", positions.min(axis=0), positions.max(axis=0)))
    at, size = (0.42, 0.5) if how.error else (0.2, 0.6)
    run(".", script,
        f"set terminal pngcairo size 1000,{PANEL_HEIGHT * len(text)} font 'DejaVu Sans,11' background 'white'\n"
        f"set output {quoted(how.output)}\n{ranges}set cbrange [0:{max(highest, 1e-300):.4g}]\n"
        f"set cblabel 'von Mises stress, kPa'\nset palette defined (0 {PALETTE})\n"
        "set pm3d depthorder corners2color mean border linecolor '#404040' linewidth 0.3\n"
        "set view 65, 30, 2.4\nset view equal xyz\nset xyplane 0\nunset border\nunset tics\nunset key\nset cbtics\n"
        f"set lmargin 0\nset rmargin 0\nset bmargin 0\nset colorbox user origin 0.88, {at:g} size 0.02, {size:g}\n" +
        (f"set multiplot layout {len(text)},1\n" if len(text) > 1 else "") + "".join(text), how.output)
