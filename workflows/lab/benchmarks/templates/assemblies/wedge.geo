// Wedge clamp [mm]: a wedge of 8 degrees pressed between a block and a wall
SetFactory("OpenCASCADE");
DefineConstant[size = 4.0]; // of cells [mm]
h = 40; t = h * Tan(8 * Pi / 180);
Point(1) = {0, 0, 0}; Point(2) = {10, 0, 0}; Point(3) = {10 + t, h, 0}; Point(4) = {0, h, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1:4}; Plane Surface(1) = {1};
e[] = Extrude {0, 0, 20} { Surface{1}; };
Point(21) = {10, 0, 0}; Point(22) = {40, 0, 0}; Point(23) = {40, h, 0}; Point(24) = {10 + t, h, 0};
Line(21) = {21, 22}; Line(22) = {22, 23}; Line(23) = {23, 24}; Line(24) = {24, 21};
Curve Loop(21) = {21:24}; Plane Surface(21) = {21};
f[] = Extrude {0, 0, 20} { Surface{21}; };
Box(9) = {-30, 0, 0, 30, h, 20};
Physical Volume("wedge") = {e[1]}; Physical Volume("block") = {f[1]}; Physical Volume("wall") = {9};
Physical Surface("wedge.top") = {e[4]};
Physical Surface("block.back") = {f[3]};
Physical Surface("wall.back") = Surface In BoundingBox{-31, -1, -1, -29, h + 1, 21};
Mesh.MeshSizeMax = size;
