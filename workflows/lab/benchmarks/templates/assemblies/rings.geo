// Press fit of two rings [mm]: .02 mm of interference
SetFactory("OpenCASCADE");
DefineConstant[size = 4.0]; // of cells [mm]
r = 20; d = 0.02;
Cylinder(1) = {0, 0, 0, 0, 0, 15, r + d}; Cylinder(2) = {0, 0, 0, 0, 0, 15, 12};
Cylinder(3) = {0, 0, -5, 0, 0, 20, 30}; Cylinder(4) = {0, 0, -5, 0, 0, 20, r};
BooleanDifference(10) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
BooleanDifference(11) = { Volume{3}; Delete; }{ Volume{4}; Delete; };
Physical Volume("inner") = {10}; Physical Volume("outer") = {11};
Physical Surface("outer.foot") = Surface In BoundingBox{-31, -31, -6, 31, 31, -4};
Physical Surface("inner.top") = Surface In BoundingBox{-21, -21, 14, 21, 21, 16};
Mesh.MeshSizeMax = size;
