// Root of a blade in its disc [mm]: flanks at 60 degrees, .5 mm of clearance under the root
SetFactory("OpenCASCADE");
a = 3 * Tan(Pi / 3);
Point(1) = {-3, 0, 0}; Point(2) = {-6, -a, 0}; Point(3) = {6, -a, 0}; Point(4) = {3, 0, 0};
Point(5) = {3, 20, 0}; Point(6) = {-3, 20, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6}; Line(6) = {6, 1};
Curve Loop(1) = {1:6}; Plane Surface(1) = {1};
b = (a + .5) / Tan(Pi / 3);
Point(11) = {-15, -15, 0}; Point(12) = {15, -15, 0}; Point(13) = {15, 0, 0}; Point(14) = {3, 0, 0};
Point(15) = {3 + b, -a - .5, 0}; Point(16) = {-3 - b, -a - .5, 0}; Point(17) = {-3, 0, 0}; Point(18) = {-15, 0, 0};
Line(11) = {11, 12}; Line(12) = {12, 13}; Line(13) = {13, 14}; Line(14) = {14, 15}; Line(15) = {15, 16};
Line(16) = {16, 17}; Line(17) = {17, 18}; Line(18) = {18, 11};
Curve Loop(2) = {11:18}; Plane Surface(2) = {2};
Physical Surface("blade") = {1}; Physical Surface("disc") = {2};
Physical Curve("blade.skin") = {1:6};
Physical Curve("disc.skin") = {12:18};
Physical Curve("disc.base") = {11};
