# SPDX-License-Identifier: MIT
"""Describes a field file in XDMF: one grid for each state, made of selections in the file's datasets."""
import os
from xml.sax.saxutils import escape

import h5py

from gnuplot import MARK
from portmet_files import text

VON_MISES = "sqrt(0.5 * (($0 - $1) * ($0 - $1) + ($1 - $2) * ($1 - $2) + ($2 - $0) * ($2 - $0)) + 3.0 * ($3 * $3 + $4 * $4 + $5 * $5))"
REAL, WHOLE = ('NumberType="Float" Precision="8"', 'NumberType="Int" Precision="4"')
# The field's order is xx yy zz xy xz yz; that of a symmetric tensor of XDMF is xx xy xz yy yz zz.
OWN, TENSOR = (0, 1, 2, 3, 4, 5), (0, 3, 4, 1, 5, 2)


class Field:
    def __init__(self, path):
        self.name = escape(os.path.basename(path))
        with h5py.File(path, "r") as file:
            self.shape = {name: data.shape for name, data in file.items()}
            self.t = file["t"][()]
            names = text(file.attrs["state_layout"]).split()
        groups = {"q": "qx qy qz", "v": "vx vy vz", "stress": "sxx syy szz sxy sxz syz"}
        self.first = {key: names.index(of.split()[0]) for key, of in groups.items() if f" {of} " in f" {' '.join(names)} "}

    def item(self, dataset, kind=REAL):
        """A whole dataset."""
        extent = " ".join(map(str, self.shape[dataset]))
        return f'<DataItem Format="HDF" {kind} Dimensions="{extent}">{self.name}:/{dataset}</DataItem>'

    def columns(self, dataset, i, j, first, count):
        """Columns of the state at time j of trajectory i. ParaView compares the beginnings of two data items to tell
        whether a geometry has changed; the comment makes them differ."""
        nnode = self.shape["z"][2]
        return (f'<DataItem ItemType="HyperSlab" Dimensions="{nnode} {count}"><!-- {i} {j} --><DataItem Dimensions="3 4" '
                f'Format="XML">{i} {j} 0 {first} 1 1 1 1 1 1 {nnode} {count}</DataItem>{self.item(dataset)}</DataItem>\n')

    def attribute(self, name, kind, content):
        return f'<Attribute Name="{name}" AttributeType="{kind}" Center="Node">\n{content}</Attribute>\n'

    def function(self, what, count, content):
        return f'<DataItem ItemType="Function" Function="{what}" Dimensions="{self.shape["z"][2]} {count}">\n{content}</DataItem>\n'

    def grid(self, i, j):
        """Mesh and attributes of a state."""
        def stress(order):
            return "".join(self.columns("z", i, j, self.first["stress"] + k, 1) for k in order)

        reference, moved = self.item("node_position_reference"), "q" in self.first
        positions = self.columns("z", i, j, self.first["q"], 3) if moved else reference
        result = (f'<Grid Name="body" GridType="Uniform">\n<Time Value="{self.t[j]:.9g}"/>\n<Topology '
                  f'TopologyType="Hexahedron" NumberOfElements="{self.shape["hexahedra"][0]}">\n{self.item("hexahedra", WHOLE)}\n'
                  f'</Topology>\n<Geometry GeometryType="XYZ">{positions}</Geometry>\n')
        if moved:
            result += self.attribute("u", "Vector", self.function("$0 - $1", 3, positions + reference))
        if "v" in self.first:
            result += self.attribute("v", "Vector", self.columns("z", i, j, self.first["v"], 3))
        if "stress" in self.first:
            result += self.attribute("stress", "Tensor6", self.function("JOIN($0, $1, $2, $3, $4, $5)", 6, stress(TENSOR)))
            result += self.attribute("von Mises stress", "Scalar", self.function(VON_MISES, 1, stress(OWN)))
        for name, dataset in ("force", "f"), ("contact force", "contact_force"):
            if dataset in self.shape:
                result += self.attribute(name, "Vector", self.columns(dataset, i, j, 0, 3))
        return result + "</Grid>\n"


def describe(path):
    field = Field(path)
    ntrajectory, ntime = field.shape["z"][:2]
    with open(os.path.splitext(path)[0] + ".xdmf", "w") as file:
        file.write('<?xml version="1.0"?>\n<!-- ' + MARK + ' -->\n<Xdmf Version="2.0">\n<Domain>\n')
        for i in range(ntrajectory):
            file.write(f'<Grid Name="trajectory {i}" GridType="Collection" CollectionType="Temporal">\n')
            file.writelines(field.grid(i, j) for j in range(ntime))
            file.write("</Grid>\n")
        file.write("</Domain>\n</Xdmf>\n")
