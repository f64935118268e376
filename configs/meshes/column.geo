// A box of 20 x 8 x 8 m in tetrahedra, for Gmsh: `portmet-mesh --split` turns each into four hexahedra.
size = 6;
Point(1) = {0, 0, 0, size};
Point(2) = {20, 0, 0, size};
Point(3) = {20, 8, 0, size};
Point(4) = {0, 8, 0, size};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
body[] = Extrude {0, 0, 8} { Surface{1}; };
Physical Volume("body") = {body[1]};
Physical Surface("clamped") = {body[5]}; // x = 0
