// Clevis, pin and lug [mm]; the pin has .02 mm of clearance
SetFactory("OpenCASCADE");
DefineConstant[size = 8.0]; // of cells [mm]
r = 10; hole = r + 0.02;
Box(1) = {0, -25, -8, 80, 50, 16}; Cylinder(2) = {0, 0, -8, 0, 0, 16, 25}; Cylinder(3) = {0, 0, -8, 0, 0, 16, hole};
BooleanUnion(10) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
BooleanDifference(11) = { Volume{10}; Delete; }{ Volume{3}; Delete; };
Box(4) = {-90, -25, -18, 90, 50, 36}; Cylinder(5) = {0, 0, -18, 0, 0, 36, 25};
Box(6) = {-70, -26, -9, 100, 52, 18}; Cylinder(7) = {0, 0, -18, 0, 0, 36, hole};
BooleanUnion(20) = { Volume{4}; Delete; }{ Volume{5}; Delete; };
BooleanDifference(21) = { Volume{20}; Delete; }{ Volume{6, 7}; Delete; };
Cylinder(30) = {0, 0, -20, 0, 0, 40, r};
Physical Volume("lug") = {11}; Physical Volume("clevis") = {21}; Physical Volume("pin") = {30};
Physical Surface("lug.end") = Surface In BoundingBox{79, -26, -9, 81, 26, 9};
Physical Surface("clevis.end") = Surface In BoundingBox{-91, -26, -19, -89, 26, 19};
Mesh.MeshSizeMax = size; Mesh.MeshSizeFromCurvature = 12; Mesh.MeshSizeExtendFromBoundary = 0;
