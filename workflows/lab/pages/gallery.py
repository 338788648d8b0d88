"""docs/gallery, a page for each ready scene: `python -m stickslip.workflows.lab.pages.gallery [NAME...]` renews it.

A scene is solved again only if its file, or the version of stickslip, is not what its page was made from.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

import typer
from PIL import Image

from stickslip import VERSION
from stickslip.workflows.formats.plus_minus import error_of, plus_minus, with_error
from stickslip.workflows.formats.templates import render
from stickslip.workflows.scene_file.read import READY

ROOT = Path(__file__).resolve().parents[3]
PAGES = ROOT / "docs" / "gallery"
RUNS = ROOT / "build" / "gallery"
MACHINES = (  # what is built and worn
    "arch", "cad_part", "dam", "disc_brake", "dovetail", "fretting", "fretting_wear", "lap_joint", "ring", "rotor",
    "rubber_mount", "shaft", "shrink_fit", "split_clamp", "spruce", "worn_roller",
)  # fmt: skip
FACTS = re.compile(r"^<!-- facts: (.*) -->$", re.MULTILINE)
WIDTH, COLOURS = 1000, 256  # of the pictures
NUMBERS = {
    "normal_force": "normal force",
    "tangential_force": "tangential force",
    "contact_area": "touches on",
    "stick_area": "sticks on",
    "max_pressure": "largest pressure",
    "dissipation_total": "dissipated since t = 0",
    "max_wear": "worn off at the most",
    "worn_volume": "worn volume",
}


def mark(name: str) -> str:
    """Return the hash of the sources of a page."""
    return hashlib.sha256(f"{VERSION}\n{scene_text(name)}".encode()).hexdigest()[:16]


def scene_text(name: str) -> str:
    """Return a ready scene's file."""
    return (READY / f"{name}.toml").read_text(encoding="utf-8")


def known(name: str) -> dict[str, Any]:
    """Return facts of a page as it is; empty if there is none."""
    page = PAGES / f"{name}.md"
    found = FACTS.search(page.read_text(encoding="utf-8")) if page.exists() else None
    return json.loads(found[1]) if found else {}


def lessons(name: str) -> tuple[str, str]:
    """Return the main number of a scene with its error, and what else its first lines say."""
    comments = []
    for line in scene_text(name).splitlines():
        if not line.startswith("#"):
            break
        comments.append(line.removeprefix("#").strip())
    return comments[0].removeprefix("Main number: "), " ".join(comments[1:])


def solved(name: str) -> dict[str, Any]:
    """Return result.json of a run of the scene as shipped, in a process of its own."""
    command = [sys.executable, "-m", "stickslip", "run", name, "-q", "-o", str(RUNS / name)]
    subprocess.run(command, check=True, cwd=ROOT)
    result: dict[str, Any] = json.loads((RUNS / name / "result.json").read_text(encoding="utf-8"))
    return result


def facts(name: str, result: dict[str, Any]) -> dict[str, Any]:
    """Return facts of a run for the list of all scenes."""
    scene = result["scene"]
    return {
        "mark": mark(name),
        "title": scene["title"],
        "model": scene["model"],
        "unknowns": result["dofs"],
        "points": result["contact_points"],
        "steps": len(result["steps"]),
        "seconds": float(f"{result['seconds']['total']:.2g}"),
        "main": lessons(name)[0],
        "number": main_number(lessons(name)[0], result),
        "effects": [row["effect"] for row in result["plan"] if row["on"]],
    }


def main_number(said: str, result: dict[str, Any]) -> str:
    """Return the main number of a run as its last step has it, with its error and unit.

    Args:
        said: its name, and what else the scene says of it.
    """
    contact, key = said.split()[0].rsplit(".", 1)
    last = result["steps"][-1]["contacts"][contact]
    number = with_error(last[key], error_of(last, key), result["units"][f"contacts.{key}"])
    return f"{contact.replace('_', ' ')}: {NUMBERS[key].partition(' since')[0]} {number}"


def shrunk(source: Path, target: Path) -> None:
    """Store a picture of a run as small as a page needs it."""
    with Image.open(source) as picture:
        found = picture.convert("RGB")
    found.thumbnail((WIDTH, WIDTH), Image.Resampling.LANCZOS)
    found.quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(target, optimize=True)


def amount(value: float, error: dict[str, Any]) -> str:
    """Return a number with its error.

    >>> amount(0.03214, {"total": 0.0001, "converges": True}), amount(2.0, {"total": None, "converges": False})
    ('0.0321 ± 0.0001', '2 (grows as the mesh is refined)')
    """
    return plus_minus(value, error["total"], error["converges"]).replace("(grows)", "(grows as the mesh is refined)")


def page(name: str, fact: dict[str, Any], result: dict[str, Any]) -> str:
    """Return the page of a scene."""
    contact = fact["main"].partition(".")[0]
    last = result["steps"][-1]["contacts"][contact]
    return render(
        "lab/pages/templates/gallery_scene.md",
        name=name,
        fact=fact,
        facts=json.dumps(fact, ensure_ascii=False),
        lesson=lessons(name)[1],
        contact=contact,
        amounts={word: amount(last[key], last["error"][key]) for key, word in NUMBERS.items() if key in last},
        loop=(PAGES / f"{name}_loop.png").exists(),
        slip=(PAGES / f"{name}_slip.png").exists(),
        scene=scene_text(name),
    )


def contents(found: dict[str, dict[str, Any]]) -> str:
    """Return the list of all scenes."""
    rest = [name for name in found if name not in MACHINES]
    kinds = {"Machines and structures": [name for name in found if name in MACHINES], "Models to learn from": rest}
    groups = {title: list(zip_longest(*[iter(names)] * 3, fillvalue="")) for title, names in kinds.items()}
    return render("lab/pages/templates/gallery.md", found=found, groups=groups)


def main(names: Annotated[list[str] | None, typer.Argument(help="solve these again, changed or not")] = None) -> None:
    """Renew the gallery."""
    found = {}
    for path in sorted(READY.glob("*.toml")):
        name = path.stem
        if known(name).get("mark") != mark(name) or name in (names or []):
            print(f"gallery: {name}", flush=True)
            result = solved(name)
            fact = facts(name, result)
            contact = f"contact_{fact['main'].partition('.')[0]}"
            drawings = sorted(RUNS.glob(f"{name}/{contact}.png")) or sorted(RUNS.glob(f"{name}/{contact}.*.png"))
            contact = drawings[0].stem if drawings else contact  # of several partners the first
            slip = contact.replace("contact_", "slip_", 1)
            pictures = {"": "deformed", "_contact": contact, "_loop": "force_displacement", "_slip": slip}
            for ending, drawn in pictures.items():
                if (RUNS / name / f"{drawn}.png").exists():  # a loop has three steps or more
                    shrunk(RUNS / name / f"{drawn}.png", PAGES / f"{name}{ending}.png")
            (PAGES / f"{name}.md").write_text(page(name, fact, result), encoding="utf-8")
        found[name] = known(name)
    (PAGES / "index.md").write_text(contents(found), encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
