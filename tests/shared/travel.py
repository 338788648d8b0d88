"""A sledge that travels under a roof and meets a wall: bodies whose skins come near in a later step."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

PLANE = """
Rectangle(1) = {0, 0, 0, 1, 1}; Rectangle(2) = {0.1, 1, 0, 0.5, 0.5}; Rectangle(3) = {1 + gap, 0, 0, 1, 1};
Physical Surface("sledge") = {1}; Physical Surface("roof") = {2}; Physical Surface("wall") = {3};
Physical Curve("sledge.left") = {4}; Physical Curve("sledge.under") = {1}; Physical Curve("roof.upper") = {7};
Physical Curve("wall.right") = {10}; Physical Curve("wall.under") = {9};
MeshSize{PointsOf{Surface{1};}} = 0.1; MeshSize{PointsOf{Surface{2};}} = 0.11; MeshSize{PointsOf{Surface{3};}} = 0.12;
"""
SPACE = """
Box(1) = {0, 0, 0, 1, 1, 1}; Box(2) = {0.1, 0, 1, 0.5, 1, 0.5}; Box(3) = {1 + gap, 0, 0, 1, 1, 1};
Physical Volume("sledge") = {1}; Physical Volume("roof") = {2}; Physical Volume("wall") = {3};
Physical Surface("sledge.left") = {1}; Physical Surface("sledge.front") = {3}; Physical Surface("sledge.under") = {5};
Physical Surface("roof.upper") = {12};
Physical Surface("wall.right") = {14}; Physical Surface("wall.front") = {15}; Physical Surface("wall.under") = {17};
MeshSize{PointsOf{Volume{1};}} = 0.34; MeshSize{PointsOf{Volume{2};}} = 0.3; MeshSize{PointsOf{Volume{3};}} = 0.4;
"""
HEAD = 'SetFactory("OpenCASCADE"); DefineConstant[gap = 0.75];'
BODIES = ("sledge", "wall", "roof")


def travel(folder: Path, dim: int = 2, order: int = 1, **tables: Any) -> dict[str, Any]:
    """A sledge under a roof is pushed in steps of .3 (in space .6); in the third one it meets a wall."""
    written = folder / f"{os.getpid()}.geo"
    written.write_text(HEAD + (PLANE if dim == 2 else SPACE))
    written.replace(folder / "travel.geo")  # another rank may read it
    up, gap, step = "xyz"[dim - 1], 0.75 if dim == 2 else 1.6, 0.3 if dim == 2 else 0.6
    under = {f"{body}_under": {"boundary": f"{body}.under", "displacement": {up: 0.0}} for body in ("sledge", "wall")}
    front = {f"{body}_front": {"boundary": f"{body}.front", "displacement": {"y": 0.0}} for body in ("sledge", "wall")}
    push = {"boundary": "sledge.left", "displacement": {"x": [[1.0, step], [4.0, 4 * step]]}}
    still = {"boundary": "wall.right", "displacement": {"x": 0.0}}
    roof = {"boundary": "roof.upper", "displacement": [0.0] * dim}
    return {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": {"file": "travel.geo", "order": order, "gap": gap},
        "bodies": {body: {"E": 1.0, "nu": 0.0} for body in BODIES},
        "contacts": {"any": {"between": "all"}},
        "supports": {"push": push, "still": still, "roof": roof, **under, **(front if dim == 3 else {})},
        "steps": {"end": 4.0, "count": 4},
        "output": {"pictures": False, "error": False},
    } | tables
