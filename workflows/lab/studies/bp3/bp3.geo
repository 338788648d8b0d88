// BP3-QD with a dip of 90 degrees: both sides of the fault x = 0, y upwards from the ground [m].
DefineConstant[count = 800]; // along the 40 km of the fault that friction holds
DefineConstant[length = 640e3]; DefineConstant[depth = 800e3];
h = 40e3 / count; r = 1.12; // growth from cell to cell
nx = Ceil(Log(1 + length / h * (r - 1)) / Log(r)); ny = Ceil(Log(1 + (depth - 40e3) / h * (r - 1)) / Log(r));
y[] = {-depth, -40e3, 0};
For side In {0:1}
  s = 100 * side; away = (2 * side - 1) * length;
  For k In {0:2}
    Point(s + 1 + k) = {0, y[k], 0};
    Point(s + 11 + k) = {away, y[k], 0};
    Line(s + 1 + k) = {s + 1 + k, s + 11 + k};
    Transfinite Curve {s + 1 + k} = nx + 1 Using Progression r;
  EndFor
  For k In {0:1}
    For i In {0:1}
      n = s + 11 + 10 * i + k;
      Line(n) = {s + 1 + 10 * i + k, s + 2 + 10 * i + k}; // upwards
      If (k == 0)
        Transfinite Curve {n} = ny + 1 Using Progression 1 / r;
      Else
        Transfinite Curve {n} = count + 1;
      EndIf
    EndFor
    Curve Loop(s + 1 + k) = {s + 1 + k, s + 21 + k, -(s + 2 + k), -(s + 11 + k)};
    Plane Surface(s + 1 + k) = {s + 1 + k};
  EndFor
EndFor
Transfinite Surface "*"; Recombine Surface "*";
Physical Surface("left") = {1, 2};
Physical Surface("right") = {101, 102};
Physical Curve("left.fault") = {12};
Physical Curve("right.fault") = {112};
Physical Curve("left.deep") = {11};
Physical Curve("right.deep") = {111};
Physical Curve("left.far") = {21, 22};
Physical Curve("right.far") = {121, 122};
