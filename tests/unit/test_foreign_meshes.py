"""Meshes of other programs, with sets of nodes, of elements and surfaces, become bodies and sides."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.drawn import scene_data
from shared.problems import SimulationOf
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.user_files.outline import Outline
from stickslip.geometry.user_files.reader import Question, ask
from stickslip.workflows.scene_file.read import from_dict

BAR = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 2, 1, 1}; Box(2) = {2, 0, 0, 1, 1, 1}; BooleanFragments{ Volume{1, 2}; Delete; }{}
Physical Volume("Hard") = {1}; Physical Volume("Soft") = {2};
l() = Surface In BoundingBox{-0.1, -0.1, -0.1, 0.1, 1.1, 1.1}; Physical Surface("Left end") = {l()};
r() = Surface In BoundingBox{2.9, -0.1, -0.1, 3.1, 1.1, 1.1}; Physical Surface("Right") = {r()};
Mesh.MeshSizeMax = 0.5;
"""
SQUARE = """
Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1}; Transfinite Curve{1, 3} = 4; Transfinite Curve{2, 4} = 3; Transfinite Surface{1};
Recombine Surface{1};
"""
CUBE = "out[] = Extrude{0, 0, 1} {Surface{1}; Layers{2}; Recombine;};"
NAMES = {"hard": ("left_end",), "soft": ("right",)}
NUMBERS = {"part_1": ("side_3",), "part_2": ("side_4",)}


def written(path: Path, script: str, order: int, dim: int = 3, incomplete: bool = True) -> Path:
    """Write what gmsh makes of a script: by gmsh itself, or by meshio, with Salome's families or a cell array."""
    geo = path.with_suffix(".geo")
    geo.write_text(f"{script}\n")
    by_gmsh = path.suffix in (".inp", ".unv", ".msh", ".bdf")
    with gmsh_session() as gmsh:
        for option in ("SaveGroupsOfElements", "SaveGroupsOfNodes"):
            gmsh.option.setNumber(f"Mesh.{option}", 1)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        gmsh.merge(str(geo))
        gmsh.model.mesh.generate(dim)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path if by_gmsh else path.with_suffix(".msh")))
    if by_gmsh:
        return path
    mesh = meshio.read(path.with_suffix(".msh"))
    nodes, tags = defaultdict[str, list[Any]](list), defaultdict[str, list[Any]](list)
    for block, tag in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        nodes[block.type].append(block.data)
        tags[block.type].append(np.asarray(tag))
    key, sign = ("cell_tags", -1) if path.suffix == ".med" else ("Material", 1)
    found = meshio.Mesh(
        mesh.points,
        [(kind, np.concatenate(rows)) for kind, rows in nodes.items()],
        cell_data={key: [sign * np.concatenate(rows) for rows in tags.values()]},
    )
    found.cell_tags = {-int(tag): [name] for name, (tag, _) in mesh.field_data.items()}
    found.point_tags = {}
    found.write(path)
    return path


def outline_of(path: Path, dim: int = 3) -> Outline:
    found = ask(Question(path=path, dim=dim, unit=1.0))
    assert isinstance(found, Outline)
    return found


@pytest.mark.parametrize("kind", ["external", "virtual", "link"])
def test_a_mesh_with_numbers_in_another_file_is_refused(kind: str, tmp_path: Path) -> None:
    """Bytes of any file of the user's would be coordinates, and stand in the results."""
    path, secret = written(tmp_path / "bar.med", BAR, 1), tmp_path / "secret"
    with h5py.File(path, "r+") as file:
        names = list[str]()
        file.visit(names.append)
        (place,) = (name for name in names if name.endswith("NOE/COO"))
        values, attributes = file[place][()], dict(file[place].attrs)
        del file[place]
        secret.write_bytes(values.tobytes())
        with h5py.File(tmp_path / "other.h5", "w") as other:
            other["x"] = values
            other["x"].attrs.update(attributes)
        if kind == "external":
            file.create_dataset(place, values.shape, values.dtype, external=[(str(secret), 0, values.nbytes)])
        elif kind == "link":
            file[place] = h5py.ExternalLink(str(tmp_path / "other.h5"), "x")
        else:
            layout = h5py.VirtualLayout(values.shape, values.dtype)
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", shape=values.shape)
            file.create_virtual_dataset(place, layout)
        if kind != "link":
            file[place].attrs.update(attributes)
    with pytest.raises(GeometryError, match="NOE/COO in another file; a mesh of one file is needed"):
        outline_of(path)


@pytest.mark.parametrize("names", [("bar.inp",), ("nodes.inp", "bar.inp")])
def test_a_deck_that_includes_itself_is_refused(names: tuple[str, ...], tmp_path: Path) -> None:
    for name, other in zip(("bar.inp", *names), names, strict=False):
        (tmp_path / name).write_text(f"*INCLUDE, INPUT={other}\n")
    with pytest.raises(GeometryError, match=r"includes itself: bar\.inp"):
        outline_of(tmp_path / "bar.inp")


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("suffix", [".inp", ".unv", ".med", ".vtu", ".vtk", ".bdf"])
def test_a_bar_of_two_materials_is_stretched_as_in_closed_form(
    suffix: str, order: int, simulation_of: SimulationOf, tmp_path: Path
) -> None:
    """Held at one end, pulled at the other: models of CalculiX, Salome, ParaView and Nastran like this one solve."""
    path = written(tmp_path / f"bar{suffix}", BAR, order)
    outline = outline_of(path)
    known = suffix in (".inp", ".unv", ".med")
    if suffix != ".bdf":
        assert outline.bodies == (NAMES if known else NUMBERS)
    hard, soft = ("hard", "soft") if known else ("part_1", "part_2")
    left, right = (f"{body}.{outline.bodies[body][0]}" for body in (hard, soft))
    scene = from_dict(
        {
            "model": "3d",
            "geometry": {"file": str(path), "order": order},
            "bodies": {hard: {"E": 1000.0, "nu": 0.0}, soft: {"E": 200.0, "nu": 0.0}},
            "supports": {"left": {"boundary": left, "displacement": [0.0, 0.0, 0.0]}},
            "loads": {"right": {"boundary": right, "traction": [1.0, 0.0, 0.0]}},
            "probes": {"end": {"point": [3.0, 0.0, 0.0]}},
        }
    )
    (step,) = simulation_of(scene).steps()
    assert_allclose(step.probes["end"].displacement[0], 2 / 1000 + 1 / 200, rtol=1e-9)


DECK = """*HEADING
*INCLUDE, INPUT=nodes.inp
*ELEMENT, TYPE=C3D8R, ELSET=Eall
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 5, 6, 7, 8,
 9, 10, 11, 12
*ELEMENT, TYPE=SPRINGA, ELSET=Springs
9, 1, 2
*NSET, NSET=Nall, GENERATE
1, 12, 1
*NSET, NSET=Foot
1, 2, 3, 4
*ELSET, ELSET=Upper
2
*ELSET, ELSET=Both
Eall
*SURFACE, NAME=Head, TYPE=ELEMENT
Upper, S2
*SURFACE, NAME=Flank
1, S3
2, S3
*SOLID SECTION, ELSET=Eall, MATERIAL=steel
"""
COLUMN = "*NODE, NSET=N\n" + "\n".join(
    f"{4 * z + k}, {x}, {y}, {z}"
    for z in range(3)
    for k, (x, y) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1)), start=1)
)


def deck(folder: Path, text: str = DECK) -> Path:
    (folder / "nodes.inp").write_text(COLUMN)
    path = folder / "column.inp"
    path.write_text(text)
    return path


def test_a_deck_of_calculix_has_bodies_by_section_and_sides_by_surface_and_node_set(
    simulation_of: SimulationOf, tmp_path: Path
) -> None:
    path = deck(tmp_path)
    outline = outline_of(path)
    assert outline.bodies == {"eall": ("head", "flank", "foot")}
    assert len(outline.entities) == 3 + 3  # the other flanks are smooth faces without a name
    data = scene_data(path, 3, "eall")
    data["bodies"] = {"eall": {"E": 1000.0, "nu": 0.0}}
    data["contacts"]["base"]["surface"] = "eall.foot"
    data["supports"] = {"top": {"boundary": "eall.head", "displacement": [0.0, 0.0, -0.02]}}
    (step,) = simulation_of(from_dict(data)).steps()
    assert_allclose(step.contacts["base"].normal_force, 10.0, rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "*SOLID SECTION, ELSET=Eall",
            "*SOLID SECTION, ELSET=Upper",
            {"upper": ("head", "flank"), "part": ("flank", "foot")},
        ),
        ("*SOLID SECTION", "** SECTION", {"both": ("head", "flank", "foot")}),
        ("TYPE=ELEMENT\nUpper, S2", "TYPE=NODE\n9, 10", {"eall": ("flank", "foot")}),
        ("1, 2, 3, 4\n*ELSET", "1, 2, 5, 6\n*ELSET", {"eall": ("head", "flank")}),  # overlaps a surface
    ],
)
def test_sets_are_chosen_by_rule(old: str, new: str, says: dict[str, tuple[str, ...]], tmp_path: Path) -> None:
    assert outline_of(deck(tmp_path, DECK.replace(old, new))).bodies == says


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("TYPE=C3D8R", "TYPE=C3D27", "is made of cells that cannot be used, C3D27"),
        ("C3D8R", "T3D2", "has no cells"),
        (
            "*ELEMENT, TYPE=SPRINGA",
            "*ELEMENT, TYPE=C3D10\n8, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11\n*ELEMENT, TYPE=SP",
            "of orders 1 and 2",
        ),
        ("*ELEMENT, TYPE=C", "*NODE\n1, 5., 5., 5.\n*ELEMENT, TYPE=C", "has two nodes 1: expected a deck of one part"),
        ("9, 10, 11, 12", "9, 10, 11, 99", "a cell refers to a node that does not exist"),
    ],
)
def test_what_cannot_be_read_is_said(old: str, new: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=says):
        outline_of(deck(tmp_path, DECK.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("suffix", "dim"), [(".inp", 2), (".unv", 2), (".med", 2), (".med", 3), (".unv", 3), (".inp", 3)]
)
def test_serendipity_cells_of_other_programs_are_pressed_evenly(
    suffix: str, dim: int, simulation_of: SimulationOf, tmp_path: Path
) -> None:
    """A block of quadrilaterals or hexahedra with nodes on their edges alone, pressed onto a smooth floor by 1 %."""
    names = {
        2: 'Physical Surface("A") = {1}; Physical Curve("Bottom") = {1}; Physical Curve("Top") = {3};',
        3: 'Physical Volume("A") = {out[1]}; Physical Surface("Bottom") = {1}; Physical Surface("Top") = {out[0]};',
    }
    script = SQUARE + (CUBE if dim == 3 else "") + names[dim]
    path = written(tmp_path / f"a{suffix}", script, 2, dim)
    data = scene_data(path, dim, "a", order=2)
    data["bodies"] = {"a": {"E": 1000.0, "nu": 0.0}}
    data["supports"] = {"top": {"boundary": "a.top", "displacement": [0.0] * (dim - 1) + [-0.01]}}
    (step,) = simulation_of(from_dict(data)).steps()
    assert_allclose(step.contacts["base"].max_pressure, 10.0, rtol=1e-8)


def test_pieces_of_a_set_are_bodies_of_their_own(simulation_of: SimulationOf, tmp_path: Path) -> None:
    """Decks of contact problems often have one section for all bodies: a cube on a cube, of nodes of its own."""
    text = DECK.replace("2, 5, 6, 7, 8,\n 9, 10, 11, 12", "2, 25, 26, 27, 28, 9, 10, 11, 12").replace("2, S3\n", "")
    text = text.replace(
        "*SURFACE, NAME=Head", "*SURFACE, NAME=Slave\n2, S1\n*SURFACE, NAME=Master\n1, S2\n*SURFACE, NAME=Head"
    )
    nodes = "\n".join(
        line.replace(str(4 + k), str(24 + k), 1) for k, line in enumerate(COLUMN.splitlines()[5:9], start=1)
    )
    path = deck(tmp_path, f"{text}*NODE\n{nodes}\n")
    assert outline_of(path).bodies == {"eall": ("flank", "master", "foot"), "eall_2": ("head", "slave")}
    data = scene_data(path, 3, "eall")
    data["bodies"] = {name: {"E": 1000.0, "nu": 0.0} for name in ("eall", "eall_2")}
    data["contacts"] = {"between": {"surface": "eall_2.slave", "against": "eall.master"}}
    data["supports"] = {"foot": {"boundary": "eall.foot", "displacement": [0.0, 0.0, 0.0]}}
    data["supports"]["head"] = {"boundary": "eall_2.head", "displacement": [0.0, 0.0, -0.02]}
    (step,) = simulation_of(from_dict(data)).steps()
    assert_allclose(step.contacts["between"].normal_force, 10.0, rtol=1e-9)
    joined = from_dict(scene_data(path, 3, "all", names={"all": ["eall", "eall_2"]}) | {"contacts": {}, "supports": {}})
    assert set(joined.geometry.bodies(3)) == {"all"}


def test_a_mesh_without_sets_has_one_body_and_its_smooth_faces(tmp_path: Path) -> None:
    path = written(tmp_path / "a.msh", SQUARE + CUBE + 'Physical Volume("A") = {out[1]};', 1)
    mesh = meshio.read(path)
    meshio.Mesh(mesh.points, [("hexahedron", mesh.cells_dict["hexahedron"])]).write(tmp_path / "a.vtu")
    outline = outline_of(tmp_path / "a.vtu")
    assert outline.bodies == {"part": ()}
    assert len(outline.entities) == 6
    scene = scene_data(tmp_path / "a.vtu", 3, "part", names={"part.bottom": ["face 1"], "part.top": ["face 2"]})
    assert set(from_dict(scene).geometry.bodies(3)["part"]) == {"bottom", "top"}
