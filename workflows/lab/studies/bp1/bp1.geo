// Half of BP1-QD: a slab one cell thick, x away from the fault, y along it, z upwards from the ground [m].
DefineConstant[count = 800]; // along the 40 km of the fault that friction holds
DefineConstant[length = 640e3]; DefineConstant[depth = 800e3];
h = 40e3 / count; r = 1.12; // growth from cell to cell
nx = Ceil(Log(1 + length / h * (r - 1)) / Log(r)); nz = Ceil(Log(1 + (depth - 40e3) / h * (r - 1)) / Log(r));
x[] = {0, length}; y[] = {0, h}; z[] = {-depth, -40e3, 0};
For k In {0:2}
  For j In {0:1}
    For i In {0:1}
      Point(1 + i + 2 * j + 4 * k) = {x[i], y[j], z[k]};
    EndFor
    Line(10 * k + 1 + j) = {1 + 2 * j + 4 * k, 2 + 2 * j + 4 * k}; // along x
    Transfinite Curve {10 * k + 1 + j} = nx + 1 Using Progression r;
  EndFor
  For i In {0:1}
    Line(10 * k + 3 + i) = {1 + i + 4 * k, 3 + i + 4 * k}; // along y
    Transfinite Curve {10 * k + 3 + i} = 2;
  EndFor
  Curve Loop(10 * k + 1) = {10 * k + 1, 10 * k + 4, -(10 * k + 2), -(10 * k + 3)};
  Plane Surface(10 * k + 1) = {10 * k + 1};
EndFor
For k In {0:1}
  For j In {0:1}
    For i In {0:1}
      n = 100 + 10 * k + 2 * j + i;
      Line(n) = {1 + i + 2 * j + 4 * k, 1 + i + 2 * j + 4 * (k + 1)}; // upwards
      If (k == 0)
        Transfinite Curve {n} = nz + 1 Using Progression 1 / r;
      Else
        Transfinite Curve {n} = count + 1;
      EndIf
    EndFor
  EndFor
  For i In {0:1}
    Curve Loop(200 + 10 * k + i) = {10 * k + 3 + i, 102 + 10 * k + i, -(10 * (k + 1) + 3 + i), -(100 + 10 * k + i)};
    Plane Surface(200 + 10 * k + i) = {200 + 10 * k + i};
    Curve Loop(204 + 10 * k + i) = {10 * k + 1 + i, 101 + 10 * k + 2 * i, -(10 * (k + 1) + 1 + i), -(100 + 10 * k + 2 * i)};
    Plane Surface(204 + 10 * k + i) = {204 + 10 * k + i};
  EndFor
  Surface Loop(k + 1) = {10 * k + 1, 10 * k + 11, 200 + 10 * k, 201 + 10 * k, 204 + 10 * k, 205 + 10 * k};
  Volume(k + 1) = {k + 1};
EndFor
Transfinite Surface "*"; Recombine Surface "*"; Transfinite Volume "*";
Physical Volume("slab") = {1, 2};
Physical Surface("slab.fault") = {210};
Physical Surface("slab.deep") = {200};
Physical Surface("slab.far") = {201, 211};
Physical Surface("slab.front") = {204, 214};
Physical Surface("slab.back") = {205, 215};
