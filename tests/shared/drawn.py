"""Blocks of 4 m by 2 m (by 2 m) as users' files of every kind, written by gmsh itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from stickslip.geometry.mesh.gmsh_session import gmsh_session

GEO = """
DefineConstant[ length = 4, height = {2, Name "Parameters/height"}, lc = 0.5 ];
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, length, height};
Physical Surface("block") = {1};
Physical Curve("block.bottom") = {1};
Physical Curve("block.top") = {3};
MeshSize{:} = lc;
"""
PY = """
def build(model, parameters):
    model.occ.addRectangle(0, 0, 0, parameters["length"], 2)
    model.occ.synchronize()
    for dim, tag, name in ((2, 1, "block"), (1, 1, "block.bottom"), (1, 3, "block.top")):
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, [tag]), name)
"""
FACES = {"part.bottom": ["face 5"], "part.top": ["face 6"]}  # gmsh's numbers of the faces of a box


def draw(path: Path, dim: int = 3, scale: float = 1.0, act: Callable[[Any], None] = lambda model: None) -> Path:
    """Write the block, in units of 1/scale metres; `act` may change the gmsh model before it is written."""
    with gmsh_session() as session:
        model = session.model
        size = [scale * length for length in (4, 2, 2)[:dim]]
        (model.occ.addRectangle if dim == 2 else model.occ.addBox)(0, 0, 0, *size)
        model.occ.synchronize()
        if path.suffix == ".msh":
            facets = (1, 3) if dim == 2 else (5, 6)
            for d, tag, name in (
                (dim, 1, "block"),
                (dim - 1, facets[0], "block.bottom"),
                (dim - 1, facets[1], "block.top"),
            ):
                group = model.addPhysicalGroup(d, [tag])
                model.setPhysicalName(d, group, name)
            session.option.setNumber("Mesh.MeshSizeMax", 0.5 * scale)
            model.mesh.generate(dim)
        act(model)
        session.write(str(path))
    return path


def scene_data(file: Path | str, dim: int = 2, body: str = "block", **geometry: Any) -> dict[str, Any]:
    """A scene that presses the block on the foundation under it."""
    return {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": {"file": str(file)} | geometry,
        "bodies": {body: {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        "contacts": {"base": {"surface": f"{body}.bottom", "against": "foundation"}},
        "supports": {"top": {"boundary": f"{body}.top", "displacement": {"x": 0.0, "y": 0.0} | {"xyz"[dim - 1]: -0.1}}},
        "output": {"pictures": False},
    }


LONG = {  # of scripts: gmsh is busy with them for minutes
    "reading": GEO + "For i In {0:1e12}\nx = i;\nEndFor\n",
    "meshing": GEO + "MeshSize{:} = 0.0005;\n",
}


HINGE = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Rectangle(2) = {1, 1, 0, 1, 1};
BooleanFragments{ Surface{1, 2}; Delete; }{}
Physical Surface("block") = {1, 2};
Physical Curve("block.bottom") = Curve In BoundingBox {-0.1, -0.1, -1, 1.1, 0.1, 1};
Physical Curve("block.left") = Curve In BoundingBox {-0.1, -0.1, -1, 0.1, 1.1, 1};
Physical Curve("block.right") = Curve In BoundingBox {1.9, 0.9, -1, 2.1, 2.1, 1};
MeshSize{:} = 0.25;
"""  # two squares that share a corner


def write_scene(folder: Path, script: str, support: str) -> Path:
    """A scene file with the geometry of a .geo script."""
    (folder / "b.geo").write_text(script)
    scene = folder / "b.toml"
    scene.write_text(
        'model = "plane strain"\ngeometry.file = "b.geo"\nbodies.block = { E = 1.0, nu = 0.3 }\n'
        'obstacles.foundation = { shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] }\n'
        'contacts.base = { surface = "block.bottom", against = "foundation" }\n'
        f'supports.{support} = {{ boundary = "block.{support}", displacement = {{ x = 0.0, y = -0.1 }} }}\n'
        "output.pictures = false\n"
    )
    return scene


def write_long(folder: Path, doing: str) -> Path:
    """A scene file whose geometry keeps gmsh busy while it is doing that."""
    return write_scene(folder, LONG[doing], "top")


def write_hinge(folder: Path) -> Path:
    """A scene file in which a square hangs on the corner of another one, which is held."""
    return write_scene(folder, HINGE, "left")
