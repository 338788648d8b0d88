// Two plates [mm] that overlap in 0 < x < 40, 10 mm thick, with washers on 15 < x < 25
SetFactory("OpenCASCADE");
Point(1) = {0, 0, 0}; Point(2) = {40, 0, 0}; Point(3) = {70, 0, 0}; Point(4) = {70, 10, 0};
Point(5) = {25, 10, 0}; Point(6) = {15, 10, 0}; Point(7) = {0, 10, 0};
Point(11) = {40, 0, 0}; Point(12) = {0, 0, 0}; Point(13) = {-30, 0, 0}; Point(14) = {-30, -10, 0};
Point(15) = {15, -10, 0}; Point(16) = {25, -10, 0}; Point(17) = {40, -10, 0};
For k In {1:7}
  Line(k) = {k, 1 + k % 7}; Line(10 + k) = {10 + k, 11 + k % 7};
EndFor
Curve Loop(1) = {1:7}; Plane Surface(1) = {1};
Curve Loop(2) = {11:17}; Plane Surface(2) = {2};
Physical Surface("upper") = {1}; Physical Surface("lower") = {2};
Physical Curve("upper.joint") = {1}; Physical Curve("lower.joint") = {11};
Physical Curve("upper.head") = {5}; Physical Curve("lower.nut") = {15};
Physical Curve("upper.end") = {3}; Physical Curve("lower.end") = {13};
