"""A bar of two materials that share nodes: one after the other, and side by side."""

from pathlib import Path
from tempfile import TemporaryDirectory

from stickslip.workflows.lab.verification.check import ONE, Check, close, problem
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.scene_file.read import from_dict

HARD, SOFT, STRETCH, PULL = 1000.0, 200.0, 3e-3, 1.0  # [Pa], [Pa], [m], [Pa]; squares of 1 m, nu = 0
GEOMETRY = """SetFactory("OpenCASCADE");
DefineConstant[ x = 1, y = 0 ];
Rectangle(1) = {0, 0, 0, 1, 1};
Rectangle(2) = {x, y, 0, 1, 1};
BooleanFragments{ Surface{1}; Delete; }{ Surface{2}; Delete; }
Physical Surface("hard") = {1};
Physical Surface("soft") = {2};
Mesh.MeshSizeMax = 0.25;
"""


def ends(x: int, y: int) -> dict[str, dict[str, list[float]]]:
    """The left and right ends, as boxes around them, of the second square at (x, y)."""
    boxes = {"hard.left": (0, 0), "soft.right": (x + 1, y)}
    if y:
        boxes |= {"hard.right": (1, 0), "soft.left": (0, y)}
    return {side: {"box": [a - 0.1, b - 0.1, -1.0, a + 0.1, b + 1.1, 1.0]} for side, (a, b) in boxes.items()}


def stretched(x: int, y: int, pull: float | None = None) -> tuple[float, float]:
    """Force on the ends [N] and displacement of the middle [m], the second square at (x, y).

    Args:
        pull: traction at the right end [Pa], where nothing else holds it; None: it is moved by STRETCH.
    """
    sides = ends(x, y)
    moved = [side for side in sides if pull is None or side.endswith("left")]
    supports = {
        side.replace(".", "_"): {"boundary": side, "displacement": {"x": STRETCH * side.endswith("right"), "y": 0.0}}
        for side in moved
    }
    loads = {side.replace(".", "_"): {"boundary": side, "traction": [pull, 0.0]} for side in sides if side not in moved}
    with TemporaryDirectory() as folder:
        (Path(folder) / "squares.geo").write_text(GEOMETRY, encoding="utf-8")
        scene = from_dict(
            {
                "model": "plane stress",
                "geometry": {"file": "squares.geo", "names": sides, "x": x, "y": y},
                "bodies": {"hard": {"E": HARD, "nu": 0.0}, "soft": {"E": SOFT, "nu": 0.0}},
                "supports": supports,
                "loads": loads,
                "probes": {"middle": {"point": [0.5 * (x + 1), 0.5 * (y + 1)]}},
            },
            Path(folder),
        )
        _, (step,) = solved(scene)
    force = -sum(float(support.force[0]) for name, support in step.supports.items() if name.endswith("left"))
    return force, float(step.probes["middle"].displacement[0])


@problem("two materials that share nodes: in series, side by side", methods=ONE)
def checks(method: str) -> list[Check]:
    """Springs in series and side by side; there is no contact, and the method of no account."""
    found = list[Check]()
    for name, at, exact, middle in (
        ("in series", (1, 0), STRETCH / (1 / HARD + 1 / SOFT), STRETCH * SOFT / (HARD + SOFT)),
        ("side by side", (0, 1), STRETCH * (HARD + SOFT), 0.5 * STRETCH),
        ("in series, held at one end", (1, 0, PULL), PULL, PULL / HARD),
        ("side by side, held at one end", (0, 1, PULL), 2 * PULL, None),
    ):
        force, displacement = stretched(*at)
        found.append(close(f"{name}: force [N]", force, exact, 1e-9, exact))
        if middle is not None:
            found.append(close(f"{name}: displacement of the middle [m]", displacement, middle, 1e-9, STRETCH))
    return found
