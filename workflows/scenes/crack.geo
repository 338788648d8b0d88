// Plate with a closed crack through its middle: the crack has two lines, which share their ends alone.
DefineConstant[coarse = 2.0]; DefineConstant[fine = 0.1]; // sizes of cells [m]: at the rim, and at the crack
DefineConstant[side = 40.0]; DefineConstant[length = 2.0]; DefineConstant[angle = 20.0]; // [m], [m], [degrees]
c = Cos(angle * Pi / 180) * length / 2;
s = Sin(angle * Pi / 180) * length / 2;
w = side / 2;
Point(1) = {-w, -w, 0, coarse};
Point(2) = {w, -w, 0, coarse};
Point(3) = {w, w * s / c, 0, coarse};
Point(4) = {w, w, 0, coarse};
Point(5) = {-w, w, 0, coarse};
Point(6) = {-w, -w * s / c, 0, coarse};
Point(7) = {-c, -s, 0, fine};
Point(8) = {c, s, 0, fine};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 5};
Line(5) = {5, 6};
Line(6) = {6, 1};
Line(7) = {6, 7};
Line(8) = {8, 3};
Line(9) = {7, 8};
Line(10) = {7, 8};
Curve Loop(1) = {1, 2, -8, -9, -7, 6};
Curve Loop(2) = {7, 10, 8, 3, 4, 5};
Plane Surface(1) = {1};
Plane Surface(2) = {2};
Physical Surface("plate") = {1, 2};
Physical Curve("plate.below") = {9};
Physical Curve("plate.above") = {10};
Physical Curve("plate.left") = {5, 6};
Physical Curve("plate.right") = {2, 3};
