// A body of two legs with a rounded inner corner, for Gmsh: 30 x 30 m, legs of 10 m, 8 m deep.
// portmet-mesh turns it into hexahedra.
size = 2.6;
Point(1) = {0, 0, 0, size};
Point(2) = {30, 0, 0, size};
Point(3) = {30, 30, 0, size};
Point(4) = {20, 30, 0, size};
Point(5) = {20, 14, 0, size};
Point(6) = {16, 14, 0, size};
Point(7) = {16, 10, 0, size};
Point(8) = {0, 10, 0, size};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 5};
Circle(5) = {5, 6, 7}; // around the point 6, with a radius of 4 m
Line(6) = {7, 8};
Line(7) = {8, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6, 7};
Plane Surface(1) = {1};
Recombine Surface {1};
Mesh.RecombinationAlgorithm = 3; // quadrilaterals everywhere
body[] = Extrude {0, 0, 8} { Surface{1}; Layers{3}; Recombine; };
Physical Volume("body") = {body[1]};
Physical Surface("clamped") = {body[8]}; // x = 0
