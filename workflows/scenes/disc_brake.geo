// Half a section of a ring of lining, x the distance from the axis [mm].
SetFactory("OpenCASCADE");
Rectangle(1) = {60, 0, 0, 40, 10};
Physical Surface("pad") = {1};
Physical Curve("pad.back") = {1};
Physical Curve("pad.face") = {3};
