"""A sector of a cyclic body, whose sides turn into each other, has the answer of the whole body."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from stickslip import GeometryError, SceneError, Simulation, SolverError, StepResult
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.shape import Request, Turn
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

Tables = dict[str, Any]


def cut(*bodies: str, first: str = "y_axis", second: str = "x_axis", **keys: Any) -> Tables:
    """Periodic tables of sectors."""
    return {
        f"{body}_cut": {"boundary": f"{body}.{first}", "with": f"{body}.{second}", "angle": 90.0} | keys
        for body in bodies
    }


def press_fit(angle: int, order: int, normal: Tables, inner_size: float) -> Tables:
    """A ring in a ring, its hole pressed with four waves and then turned."""
    waves = "2e-3*(1+0.5*(x**4-6*x**2*y**2+y**4)/(x**2+y**2)**2)"
    return {
        "model": "plane strain",
        "geometry": {
            "builder": "rings", "inner_radius": 0.5, "radius": 1.0, "outer_radius": 2.0, "interference": 1e-3,
            "angle": angle, "mesh_size": 0.5, "inner_mesh_size": inner_size, "cells": "tensor", "order": order,
        },
        "bodies": {"inner": {"E": 1.0, "nu": 0.3}, "outer": {"E": 2.0, "nu": 0.2}},
        "contacts": {
            "fit": {
                "surface": "outer.inside", "against": "inner.outside",
                "normal": normal, "friction": {"law": "coulomb", "mu": 0.05},
            }
        },
        "supports": {
            "housing": {
                "boundary": "outer.outside", "displacement": {"x": "-4e-3*y*max(t-1,0)", "y": "4e-3*x*max(t-1,0)"}
            }
        },
        "elastic_support": {"bed": {"boundary": "inner.inside", "tangential": 5.0}},
        "loads": {"waves": {"boundary": "inner.inside", "pressure": waves}},
        "steps": {"end": 2.0, "count": 2},
    }  # fmt: skip


def last_of(tables: Tables, folder: Path | None = None) -> tuple[Simulation, StepResult]:
    simulation = prepare(from_dict(tables, folder) if folder else from_dict(tables))
    *_, last = simulation.steps()
    return simulation, last


def same(sector: StepResult, whole: StepResult, count: int, rtol: float = 1e-8) -> None:
    """Numbers of a sector are those of the whole body, or its part of them."""
    for name, own in sector.contacts.items():
        all_of_it = whole.contacts[name]
        for key in ("normal_force", "contact_area", "slip_area", "dissipation_total"):
            assert getattr(own, key) * count == pytest.approx(getattr(all_of_it, key), rel=rtol, abs=1e-15)
        assert_allclose(own.moment[-1] * count, all_of_it.moment[-1], rtol=1e3 * rtol)
        for key in ("max_pressure", "max_slip"):
            assert getattr(own, key) == pytest.approx(getattr(all_of_it, key), rel=rtol, abs=1e-15)
    for key in ("stored", "external", "dissipated"):
        assert getattr(sector.energy, key) * count == pytest.approx(getattr(whole.energy, key), rel=rtol)


RIGID = {"law": "unilateral"}


@pytest.mark.parametrize(("order", "normal"), [(1, RIGID), (2, RIGID), (1, {"law": "compliance", "c_n": 10.0})])
def test_a_quarter_of_a_press_fit_that_turns_is_a_quarter_of_the_whole(order: int, normal: Tables) -> None:
    _, whole = last_of(press_fit(360, order, normal, 0.25))
    simulation, sector = last_of(press_fit(90, order, normal, 0.25) | {"periodic": cut("inner", "outer")})
    assert whole.contacts["fit"].slip_area > 0
    same(sector, whole, 4)
    assert max(audit(simulation, sector).values()) < 1e-7


@pytest.mark.parametrize(
    ("contact", "solver"),
    [
        ({"operator": "node-to-segment"}, {}),
        ({}, {"method": "tangent-cg"}),
        ({}, {"method": "surface-uzawa", "surface": "matrix-free"}),
    ],
)
def test_it_is_so_for_other_operators_and_methods(contact: Tables, solver: Tables) -> None:
    fits = [press_fit(angle, 1, RIGID, 0.25) | {"solver": solver | {"tolerance": 1e-11}} for angle in (360, 90)]
    for fit in fits:
        fit["contacts"]["fit"] |= contact
    fits[1] |= {"periodic": cut("inner", "outer")}
    (_, whole), (simulation, sector) = map(last_of, fits)
    same(sector, whole, 4)
    assert max(audit(simulation, sector).values()) < 1e-7


def sliding_fit(angle: int, turn: float, **contact: Any) -> Tables:
    """The outer ring turns on the inner one by a few degrees, its points slide past facets and past the cut."""
    fit = press_fit(angle, 1, RIGID, 0.1)
    fit["geometry"] |= {"mesh_size": 0.25, "interference": 0.02}
    fit["supports"]["housing"]["displacement"] = {"x": f"-{turn}*y*max(t-1,0)", "y": f"{turn}*x*max(t-1,0)"}
    fit["contacts"]["fit"] |= {"sliding": True} | contact
    return fit | ({"periodic": cut("inner", "outer")} if angle == 90 else {})


@pytest.mark.parametrize(
    ("turn", "contact"),
    [
        (0.12, {}),
        (-0.12, {"normal": {"law": "compliance", "c_n": 10.0}}),
        (0.12, {"operator": "node-to-segment", "surface": "inner.outside", "against": "outer.inside"}),
    ],
)
def test_points_slide_past_the_cut_on_what_lies_in_the_sectors_beside_it(turn: float, contact: Tables) -> None:
    (_, whole), (simulation, sector) = (last_of(sliding_fit(angle, turn, **contact)) for angle in (360, 90))
    same(sector, whole, 4, 1e-7)  # pairs are searched to that
    assert max(audit(simulation, sector).values()) < 1e-7


def test_points_that_would_slide_past_the_sectors_beside_theirs_are_told(caplog: pytest.LogCaptureFixture) -> None:
    fit = sliding_fit(90, 0.0)
    fit["supports"]["housing"]["displacement"] = {"x": "(-1.5*x-0.9*y)*max(t-1,0)", "y": "(0.9*x-1.5*y)*max(t-1,0)"}
    with pytest.raises(SolverError):
        last_of(fit)
    assert "past the sectors beside theirs; mesh more of the whole" in caplog.text


@pytest.mark.parametrize("sliding", [False, True])
def test_each_partner_of_a_side_of_a_sector_has_the_numbers_of_the_whole(sliding: bool) -> None:
    """Eight pins in a ring, two in a quarter of it, which a turn of its rim drags along."""
    found = []
    for angle in (360, 90):
        at = np.radians(np.arange(22.5, angle, 45.0))
        pins = {
            f"pin_{k}": {"shape": "cylinder", "point": [0.06 * np.cos(a), 0.06 * np.sin(a)], "radius": 0.445}
            for k, a in enumerate(at)
        }
        tables = {
            "model": "plane strain", "bodies": {"ring": {"E": 1.0, "nu": 0.3}}, "obstacles": pins,
            "geometry": {"builder": "ring", "inner_radius": 0.5, "outer_radius": 1.0, "angle": angle,
                         "mesh_size": 0.125, "cells": "tensor", "order": 1},
            "contacts": {"c": {"surface": "ring.inner", "against": [*pins], "sliding": sliding,
                               "friction": {"law": "coulomb", "mu": 0.2}}},
            "supports": {"rim": {"boundary": "ring.outer", "displacement": {"x": "-1e-3*y", "y": "1e-3*x"}}},
        }  # fmt: skip
        _, last = last_of(tables | ({"periodic": cut("ring")} if angle == 90 else {}))
        found.append([(c.normal_force, c.max_slip, c.moment[-1]) for c in last.contacts.values()])
    assert_allclose(found[0], found[1] * 4, rtol=1e-8)


DISC = """
DefineConstant[ angle = 90 ]; n = angle / 90;
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {0, 1, 0}; Point(4) = {-1, 0, 0}; Point(5) = {0, -1, 0};
For k In {1:4}
  Line(k) = {1, k + 1};
EndFor
For k In {1:n}
  Circle(10 + k) = {k + 1, 1, k % 4 + 2}; Curve Loop(k) = {k, 10 + k, -(k % 4 + 1)}; Plane Surface(k) = {k};
EndFor
Transfinite Curve{:} = 5; Physical Surface("disc") = {1:n}; Physical Curve("disc.rim") = {11:10+n};
If (n < 4)
  Physical Curve("disc.first") = {1}; Physical Curve("disc.second") = {2};
EndIf
"""
PIE = """
SetFactory("OpenCASCADE"); DefineConstant[ angle = 90 ]; DefineConstant[ rim = 0 ];
Cylinder(1) = {0, 0, 0, 0, 0, 0.5, 1, angle * Pi / 180}; Physical Volume("disc") = {1};
t() = Surface In BoundingBox {-2, -2, 0.49, 2, 2, 0.51}; Physical Surface("disc.top") = {t()};
b() = Surface In BoundingBox {-2, -2, -0.01, 2, 2, 0.01};
If (rim)
  Physical Surface("disc.bottom") = {b(), 1};
Else
  Physical Surface("disc.bottom") = {b()};
EndIf
If (angle < 360)
  f() = Surface In BoundingBox {-0.01, -0.01, -0.01, 1.01, 0.01, 0.51}; Physical Surface("disc.first") = {f()};
  g() = Surface In BoundingBox {-0.01, -0.01, -0.01, 0.01, 1.01, 0.51}; Physical Surface("disc.second") = {g()};
EndIf
"""


def turned_on_its_axis(folder: Path, dim: int, angle: int, rim: int = 0) -> tuple[Simulation, StepResult]:
    """A disc that is dragged round in a ring that is too small, or in 3D by a floor that turns beneath it."""
    (folder / "disc.geo").write_text(PIE if dim == 3 else DISC)
    ring = {"shape": "cylinder", "point": [0.0, 0.0], "radius": 0.999, "inside": True}
    floor = {"shape": "plane", "point": [0.0] * 3, "normal": [0.0, 0.0, 1.0]}
    drive = {"point": [0.0] * 3, "axis": [0.0, 0.0, 1.0], "angle": [[0, 0], [1, 0], [2, 0.02]]}
    press = {"x": 0.0, "y": 0.0, "z": "-0.01*(1+x**2+y**2)*min(t,1)"}
    size = {"mesh_size": 0.25, "rim": rim} if dim == 3 else {}
    tables = {
        "model": "3d" if dim == 3 else "plane strain", "geometry": {"file": "disc.geo", "angle": angle} | size,
        "bodies": {"disc": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"other": floor | {"rotation": drive} if dim == 3 else ring},
        "contacts": {"c": {"surface": "disc.bottom" if dim == 3 else "disc.rim", "against": "other",
                           "friction": {"law": "coulomb", "mu": 0.1}}},
        "supports": {"top": {"boundary": "disc.top", "displacement": press}} if dim == 3 else {},
        "body_force": {} if dim == 3 else {"disc": {"force": ["-4e-4*y*max(t-1,0)", "4e-4*x*max(t-1,0)"]}},
        "steps": {"end": 2.0, "count": 2},
    }  # fmt: skip
    return last_of(tables | ({"periodic": cut("disc", first="second", second="first")} if angle == 90 else {}), folder)


@pytest.mark.parametrize(("dim", "rtol"), [(2, 2e-3), (3, 0.05)])
def test_a_sector_may_reach_its_axis_whose_points_stay_on_it(dim: int, rtol: float, tmp_path: Path) -> None:
    _, whole = turned_on_its_axis(tmp_path, dim, 360)  # whose sectors are not meshed alike
    simulation, sector = turned_on_its_axis(tmp_path, dim, 90)
    assert simulation.system.constraints.periodic.fixed
    same(sector, whole, 4, rtol)
    assert max(audit(simulation, sector).values()) < 1e-7


@pytest.mark.parametrize(("order", "normal"), [(1, RIGID), (2, RIGID), (1, {"law": "compliance", "c_n": 10.0})])
def test_meshes_of_both_sides_need_not_match(order: int, normal: Tables) -> None:
    _, whole = last_of(press_fit(360, order, normal, 0.19))
    _, sector = last_of(press_fit(90, order, normal, 0.19) | {"periodic": cut("inner", "outer")})
    same(sector, whole, 4)


def test_either_side_of_a_cut_may_follow() -> None:
    other = cut("inner", "outer", first="x_axis", second="y_axis", angle=-90.0)
    same(last_of(press_fit(90, 1, RIGID, 0.25) | {"periodic": other})[1], last_of(press_fit(360, 1, RIGID, 0.25))[1], 4)


RINGS = """
SetFactory("OpenCASCADE"); Mesh.ElementOrder = 2; Mesh.RandomFactor = 1e-9;
For k In {1:2}
  r = (k == 1 ? 0.5 : 1); s = (k == 1 ? 1 : 1.6); h = (k == 1 ? 0.6 : 0.8); n = 1000 * k;
  Point(n + 1) = {r, 0, 0, h}; Point(n + 2) = {s, 0, 0, h};
  Point(n + 3) = {s, 0, 0.4, h}; Point(n + 4) = {r, 0, 0.4, h};
  For j In {1:4}
    Line(n + j) = {n + j, n + j % 4 + 1};
  EndFor
  Curve Loop(n) = {n + 1:n + 4}; Plane Surface(n) = {n};
  out[] = Extrude {{0, 0, 1}, {0, 0, 0}, Pi / 2} { Surface{n}; };
  If (k == 1)
    Physical Volume("inner") = {out[1]}; Physical Surface("inner.first") = {n};
    Physical Surface("inner.second") = {out[0]}; Physical Surface("inner.bottom") = {out[2]};
    Physical Surface("inner.outside") = {out[3]}; Physical Surface("inner.inside") = {out[5]};
  Else
    Physical Volume("outer") = {out[1]}; Physical Surface("outer.first") = {n};
    Physical Surface("outer.second") = {out[0]}; Physical Surface("outer.bottom") = {out[2]};
    Physical Surface("outer.outside") = {out[3]}; Physical Surface("outer.inside") = {out[5]};
  EndIf
  Periodic Surface {out[0]} = {n} Rotate {{0, 0, 1}, {0, 0, 0}, Pi / 2};
EndFor
"""


def turned_copies(folder: Path, copies: int) -> str:
    """The name of a mesh of a quarter of two rings, or of four copies of it that are the whole."""
    (folder / "rings.geo").write_text(RINGS)
    with gmsh_session() as gmsh:
        gmsh.merge(str(folder / "rings.geo"))
        gmsh.model.mesh.generate(3)
        tags, x, _ = gmsh.model.mesh.getNodes()
        x = np.reshape(x, (-1, 3))[np.argsort(tags)]
        turns = [np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) for c, s in [(1, 0), (0, 1), (-1, 0), (0, -1)][:copies]]
        blocks = []
        for dim, group in gmsh.model.getPhysicalGroups():
            (entity,), name = gmsh.model.getEntitiesForPhysicalGroup(dim, group), gmsh.model.getPhysicalName(dim, group)
            kinds, _, (rows,) = gmsh.model.mesh.getElements(dim, entity)
            if copies == 1 or name.split(".")[-1] not in ("first", "second"):
                blocks.append((dim, name, kinds[0], np.searchsorted(np.sort(tags), rows)))
        body = np.zeros(len(x))
        for _, name, _, rows in blocks:
            body[rows] = name.startswith("inner")
        every = np.concatenate([np.column_stack([x @ turn, body]) for turn in turns])
        _, first, same = np.unique((every + 0.5e-7).round(6), axis=0, return_index=True, return_inverse=True)
        gmsh.model.add("turned")
        for number, (dim, name, kind, rows) in enumerate(sorted(blocks, key=lambda block: -block[0]), start=1):
            gmsh.model.addDiscreteEntity(dim, number)
            if number == 1:
                gmsh.model.mesh.addNodes(dim, number, np.arange(1, len(first) + 1), every[first, :3].ravel())
            nodes = [same.ravel()[rows + k * len(x)] + 1 for k in range(copies)]
            gmsh.model.mesh.addElementsByType(number, kind, [], np.concatenate(nodes))
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [number]), name)
        gmsh.write(str(folder / f"{copies}.msh"))
    return f"{copies}.msh"


@pytest.mark.parametrize("contact", [{}, {"operator": "node-to-face"}])
def test_a_quarter_of_quadratic_tetrahedra_is_a_quarter_of_the_whole(contact: Tables, tmp_path: Path) -> None:
    """Curved facets at the cut press along the normals of their points, those of both sectors beside it."""
    found = []
    for angle in (360, 90):
        fit = press_fit(angle, 2, RIGID, 0.25)
        fit |= {"model": "3d", "geometry": {"file": turned_copies(tmp_path, 4 if angle == 360 else 1), "order": 2}}
        fit["contacts"]["fit"] |= {"gap_offset": -1e-3} | contact
        fit["supports"]["housing"]["displacement"]["z"] = 0.0
        fit["solver"] = {"tolerance": 1e-11}
        if angle == 90:
            fit["periodic"] = cut("inner", "outer", first="second", second="first")
        found.append(last_of(fit, tmp_path)[1])
    same(found[1], found[0], 4)


SOCKET = """
DefineConstant[ angle = 90 ]; n = angle / 90; m = 8;
Point(1) = {0, 0, 0};
For k In {0:3}
  c = Cos(k * Pi / 2); s = Sin(k * Pi / 2);
  For j In {1:4}
    r = (j == 1 ? 0.4 : (j == 4 ? 2 : 1));
    Point(10 * j + k) = {r * c, r * s, 0};
  EndFor
EndFor
For k In {0:3}
  Line(100 + k) = {10 + k, 20 + k}; Line(110 + k) = {30 + k, 40 + k};
EndFor
For k In {0:n - 1}
  e = (k + 1) % 4;
  Circle(200 + k) = {10 + k, 1, 10 + e}; Line(210 + k) = {20 + k, 20 + e};
  Line(220 + k) = {30 + k, 30 + e}; Circle(230 + k) = {40 + k, 1, 40 + e};
  Curve Loop(1 + k) = {100 + k, 210 + k, -(100 + e), -(200 + k)}; Plane Surface(1 + k) = {1 + k};
  Curve Loop(11 + k) = {110 + k, 230 + k, -(110 + e), -(220 + k)}; Plane Surface(11 + k) = {11 + k};
EndFor
Transfinite Curve{100:103} = 5; Transfinite Curve{110:113} = 6;
Transfinite Curve{200:200+n-1, 210:210+n-1} = m + 1; Transfinite Curve{220:220+n-1, 230:230+n-1} = m + 3;
Transfinite Surface{:};
Physical Surface("bar") = {1:n}; Physical Surface("ring") = {11:10+n};
Physical Curve("bar.bore") = {200:199+n}; Physical Curve("bar.face") = {210:209+n};
Physical Curve("ring.face") = {220:219+n}; Physical Curve("ring.rim") = {230:229+n};
If (n < 4)
  Physical Curve("bar.first") = {100}; Physical Curve("bar.second") = {101};
  Physical Curve("ring.first") = {110}; Physical Curve("ring.second") = {111};
EndIf
"""


def socket(folder: Path, angle: int, order: int, contact: Tables) -> tuple[Simulation, StepResult]:
    """A square bar pressed into a square hole whose rim turns; a quarter is cut along the corners of both."""
    (folder / "socket.geo").write_text(SOCKET)
    fit = {
        "surface": "bar.face",
        "against": "ring.face",
        "gap_offset": -1e-3,
        "friction": {"law": "coulomb", "mu": 0.3},
    }
    tables: Tables = {
        "model": "plane strain",
        "geometry": {"file": "socket.geo", "angle": angle, "order": order},
        "bodies": {"bar": {"E": 1.0, "nu": 0.3}, "ring": {"E": 2.0, "nu": 0.2}},
        "contacts": {"fit": fit | contact},
        "supports": {
            "rim": {"boundary": "ring.rim", "displacement": {"x": "-1e-3*y*max(t-1,0)", "y": "1e-3*x*max(t-1,0)"}}
        },
        "elastic_support": {"bed": {"boundary": "bar.bore", "tangential": 1.0, "normal": 0.1}},
        "steps": {"end": 2.0, "count": 2},
    }
    sector = {"periodic": cut("bar", "ring", first="second", second="first")}
    return last_of(tables | (sector if angle == 90 else {}), folder)


@pytest.mark.parametrize(
    ("order", "contact"),
    [
        (1, {}),
        (1, {"sliding": True}),
        (1, {"operator": "node-to-segment"}),
        (1, {"normal": {"law": "compliance", "c_n": 10.0}}),
        (2, {"surface": "ring.face", "against": "bar.face"}),
    ],
)
def test_sides_may_have_their_corners_where_the_sector_is_cut(order: int, contact: Tables, tmp_path: Path) -> None:
    _, whole = socket(tmp_path, 360, order, contact)
    simulation, sector = socket(tmp_path, 90, order, contact)
    assert 0 < sector.contacts["fit"].slip_area < sector.contacts["fit"].contact_area
    same(sector, whole, 4)
    assert max(audit(simulation, sector).values()) < 1e-7


def test_an_edge_may_run_from_cut_to_cut_in_3d(tmp_path: Path) -> None:
    """A side that is bottom and rim of a quarter of a disc, on a floor that turns: as the bottom alone."""
    _, bottom = turned_on_its_axis(tmp_path, 3, 90)
    _, both = turned_on_its_axis(tmp_path, 3, 90, rim=1)
    for key in ("normal_force", "contact_area", "slip_area", "dissipation_total"):
        assert getattr(both.contacts["c"], key) == pytest.approx(getattr(bottom.contacts["c"], key), rel=1e-8)


PINS = """
DefineConstant[ angle = 90 ]; n = angle / 90; m = 8;
Point(1) = {0, 0, 0};
For k In {0:3}
  For j In {1:2}
    r = (j == 1 ? 0.5 : 1); Point(10 * j + k) = {r * Cos(k * Pi / 2), r * Sin(k * Pi / 2), 0};
  EndFor
  Line(10 + k) = {10 + k, 20 + k};
EndFor
For k In {0:n-1}
  e = (k + 1) % 4;
  Circle(20 + k) = {10 + k, 1, 10 + e}; Circle(30 + k) = {20 + k, 1, 20 + e};
  Curve Loop(1 + k) = {10 + k, 30 + k, -(10 + e), -(20 + k)}; Plane Surface(1 + k) = {1 + k};
  a = k * Pi / 2 + 0.04; x = 0.405 * Cos(a); y = 0.405 * Sin(a); q = 100 * (k + 1); Point(q) = {x, y, 0};
  For i In {0:3}
    b = a + i * Pi / 2; c = Cos(b); s = Sin(b);
    Point(q + 1 + i) = {x + 0.04 * c, y + 0.04 * s, 0}; Point(q + 11 + i) = {x + 0.1 * c, y + 0.1 * s, 0};
    Line(q + 1 + i) = {q + 1 + i, q + 11 + i};
  EndFor
  For i In {0:3}
    j = (i + 1) % 4;
    Circle(q + 11 + i) = {q + 1 + i, q, q + 1 + j}; Circle(q + 21 + i) = {q + 11 + i, q, q + 11 + j};
    Curve Loop(q + i) = {q + 1 + i, q + 21 + i, -(q + 1 + j), -(q + 11 + i)}; Plane Surface(q + i) = {q + i};
    Transfinite Curve{q + 1 + i} = 3; Transfinite Curve{q + 11 + i, q + 21 + i} = 6;
  EndFor
EndFor
Transfinite Curve{10:13} = 5; Transfinite Curve{20:20+n-1, 30:30+n-1} = 20; Transfinite Surface{:};
Physical Surface("ring") = {1:n}; Physical Curve("ring.inner") = {20:19+n}; Physical Curve("ring.rim") = {30:29+n};
p() = {}; r() = {}; b() = {};
For k In {0:n-1}
  q = 100 * (k + 1); p() += {q:q+3}; r() += {q+21:q+24}; b() += {q+11:q+14};
EndFor
Physical Surface("pin") = {p()}; Physical Curve("pin.rim") = {r()}; Physical Curve("pin.bore") = {b()};
If (n < 4)
  Physical Curve("ring.first") = {10}; Physical Curve("ring.second") = {10+n};
EndIf
"""


def pins(folder: Path, angle: int, contact: Tables) -> tuple[Simulation, StepResult]:
    """A ring about four pins on springs that lie across the cuts, which do not meet their mesh; it turns by 0.1 rad."""
    (folder / "pins.geo").write_text(PINS)
    drive = {"x": "-0.1*y*max(t-1,0)", "y": "0.1*x*max(t-1,0)"}
    tables: Tables = {
        "model": "plane strain",
        "geometry": {"file": "pins.geo", "angle": angle},
        "bodies": {"ring": {"E": 1.0, "nu": 0.3}, "pin": {"E": 2.0, "nu": 0.2}},
        "contacts": {"fit": {"friction": {"law": "coulomb", "mu": 0.2}, "sliding": True} | contact},
        "supports": {"rim": {"boundary": "ring.rim", "displacement": drive}},
        "elastic_support": {"bed": {"boundary": "pin.bore", "tangential": 1.0, "normal": 1.0}},
        "steps": {"end": 2.0, "count": 2},
    }
    sector = {"periodic": cut("ring", first="second", second="first", angle=float(angle))}
    return last_of(tables | (sector if angle < 360 else {}), folder)


@pytest.mark.parametrize(
    ("angle", "contact"),
    [
        (90, {"surface": "ring.inner", "against": "pin.rim"}),
        (180, {"surface": "pin.rim", "against": "ring.inner"}),
        (90, {"between": "all"}),
    ],
)
def test_a_body_across_the_cut_touches_the_sectors_on_both_sides(angle: int, contact: Tables, tmp_path: Path) -> None:
    _, whole = pins(tmp_path, 360, contact)
    simulation, sector = pins(tmp_path, angle, contact)
    assert sector.contacts[next(iter(sector.contacts))].contact_area > 0
    same(sector, whole, 360 // angle, 1e-6)  # gmsh's meshes are alike to 1e-9
    assert max(audit(simulation, sector).values()) < 1e-6


def test_bodies_that_touch_turn_alike() -> None:
    quarter, back = (Turn(angle=angle, point=(0.0, 0.0)) for angle in (90.0, -90.0))
    alike = Request(model="plane strain", turns={"hub.cut": quarter, "shaft.cut": back})
    alike.refuse_other_sectors()
    for other in (Turn(angle=60.0, point=(0.0, 0.0)), Turn(angle=90.0, point=(1.0, 0.0))):
        with pytest.raises(SceneError, match=r"shaft\.cut turns as no other side"):
            replace(alike, turns={"hub.cut": quarter, "shaft.cut": other}).refuse_other_sectors()


SECTOR = """
SetFactory("OpenCASCADE");
a = Pi/3; r = 0.5; s = 1.0;
Point(1) = {r, 0, 0}; Point(2) = {s, 0, 0}; Point(3) = {r*Cos(a), r*Sin(a), 0}; Point(4) = {s*Cos(a), s*Sin(a), 0};
Point(5) = {0, 0, 0};
Line(1) = {1, 2}; Line(2) = {3, 4}; Circle(3) = {1, 5, 3}; Circle(4) = {2, 5, 4};
Curve Loop(1) = {1, 4, -2, -3}; Plane Surface(1) = {1};
"""
NAMED = {
    2: """
Physical Surface("ring") = {1}; Physical Curve("ring.first") = {1}; Physical Curve("ring.second") = {2};
Physical Curve("ring.inner") = {3}; Physical Curve("ring.outer") = {4};
""",
    3: """
out[] = Extrude {0, 0, 0.25} { Surface{1}; };
Physical Volume("ring") = {out[1]};
Physical Surface("ring.first") = {out[2]}; Physical Surface("ring.second") = {out[4]};
Physical Surface("ring.inner") = {out[5]}; Physical Surface("ring.outer") = {out[3]};
Physical Surface("ring.bottom") = {1}; Physical Surface("ring.top") = {out[0]};
""",
}
E, NU, MU, DELTA = 1.0, 0.3, 0.2, 1e-3


@pytest.mark.parametrize("dim", [2, 3])
def test_a_sixth_of_a_users_file_on_a_shaft_that_turns_has_the_pressure_of_lame(dim: int, tmp_path: Path) -> None:
    """A ring on a rigid shaft that is too large by DELTA slips everywhere; springs along its outside hold it."""
    (tmp_path / "sector.geo").write_text(SECTOR + NAMED[dim])
    flat = {"bottom": "z", "top": "z"} if dim == 3 else {}
    middle, along = [0.0] * dim, {"axis": [0.0, 0.0, 1.0]} if dim == 3 else {}
    tables = {
        "model": "3d" if dim == 3 else "plane strain",
        "geometry": {"file": "sector.geo", "mesh_size": 0.15 if dim == 3 else 0.1, "order": 2},
        "bodies": {"ring": {"E": E, "nu": NU}},
        "obstacles": {
            "shaft": {
                "shape": "cylinder", "point": middle, "radius": 0.5 + DELTA, **along,
                "rotation": {"point": middle, "angle": [[0, 0], [1, 0], [2, 0.1]], **along},
            }
        },
        "contacts": {"fit": {"surface": "ring.inner", "against": "shaft", "friction": {"law": "coulomb", "mu": MU}}},
        "supports": {side: {"boundary": f"ring.{side}", "displacement": {axis: 0.0}} for side, axis in flat.items()},
        "elastic_support": {"bed": {"boundary": "ring.outer", "tangential": 1.0}},
        "periodic": cut("ring", first="second", second="first", angle=60.0),
        "steps": {"end": 2.0, "count": 2},
    }  # fmt: skip
    simulation, last = last_of(tables, tmp_path)
    a, b = 0.5, 1.0
    pressure = DELTA * E * (b**2 - a**2) / ((1 + NU) * a**2 * ((1 - 2 * NU) * a + b**2 / a))
    fit = last.contacts["fit"]
    force = pressure * a * np.pi / 3 * (0.25 if dim == 3 else 1.0)
    assert fit.normal_force == pytest.approx(force, rel=3e-3)
    assert fit.max_pressure == pytest.approx(pressure, rel=0.1 if dim == 3 else 0.02)  # at a node of a free mesh
    assert_allclose(fit.moment[-1], MU * force * a, rtol=5e-3)
    assert fit.slip_area == pytest.approx(fit.contact_area, rel=1e-9)
    assert max(audit(simulation, last).values()) < 1e-7


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"angle": 360.0}, "periodic.ring_cut.angle = 360"),
        ({"axis": [0.0, 0.0, 1.0]}, "a plane model turns about z"),
        ({"point": [0.0]}, "expected 2 components"),
        ({"angle": 0.0, "point": [0.0, 0.0]}, "a side that is shifted has no axis"),
        ({"angle": 80.0}, "their meshes do not match"),
    ],
)
def test_a_turn_that_fits_no_sector_is_refused(change: Tables, message: str) -> None:
    tables = {
        "model": "plane strain",
        "geometry": {"builder": "ring", "inner_radius": 0.5, "outer_radius": 1.0, "angle": 90, "mesh_size": 0.5},
        "bodies": {"ring": {"E": 1.0, "nu": 0.3}},
        "supports": {"hold": {"boundary": "ring.outer", "displacement": {"x": 0.0, "y": 0.0}}},
        "loads": {"push": {"boundary": "ring.inner", "pressure": 1.0}},
        "periodic": cut("ring", **change),
    }
    with pytest.raises((SceneError, GeometryError), match=message):
        last_of(tables)
