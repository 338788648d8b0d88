// Ball joint [mm]: a ball on a stem in a deep socket, .05 mm of clearance
SetFactory("OpenCASCADE");
DefineConstant[size = 2.2]; // of cells [mm]
Box(1) = {-10, -10, -14, 20, 20, 16}; Sphere(2) = {0, 0, 0, 8.05};
BooleanDifference(10) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Sphere(3) = {0, 0, 0, 8}; Cylinder(4) = {0, 0, 0, 0, 0, 20, 4};
BooleanUnion(11) = { Volume{3}; Delete; }{ Volume{4}; Delete; };
Physical Volume("socket") = {10}; Physical Volume("ball") = {11};
Physical Surface("socket.bottom") = Surface In BoundingBox{-11, -11, -15, 11, 11, -13};
Physical Surface("ball.top") = Surface In BoundingBox{-5, -5, 19, 5, 5, 21};
Mesh.MeshSizeMax = size; Mesh.MeshSizeExtendFromBoundary = 0;
