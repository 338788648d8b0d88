"""Pairs of faces that touch: listed and drawn by `stickslip contacts`, written as a scene by `stickslip new`."""

from __future__ import annotations

import errno
import os
import re
import shutil
from pathlib import Path

import numpy as np
from mpi4py import MPI

from stickslip.geometry.arrays import SLIGHT
from stickslip.geometry.errors import FolderError, SceneError
from stickslip.geometry.user_files.open_file import KINDS, apart, kind_of
from stickslip.geometry.user_files.parts import FACET_WORD
from stickslip.geometry.user_files.touching import joined
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.workflows.formats.files import disk_errors, write_output
from stickslip.workflows.formats.marker import declare, is_marked, mark, marker_of
from stickslip.workflows.run.ranks import raise_together
from stickslip.workflows.run.terminal import console, print_table, table_of
from stickslip.workflows.scene_file import proposal
from stickslip.workflows.scene_file.read import find, named, read_geometry

PICTURE = re.compile(r"\d+_\w+\.png")


def list_contacts(source: str, unit: str | None, units: str | None, within: float | None, folder: Path | None) -> None:
    """Print the pairs of a geometry file, or of a scene's, and draw each in a folder; collective.

    Raises:
        FolderError: the folder exists, and has not been made here.
    """
    raise_together(MPI.COMM_WORLD, lambda: _list(source, unit, units, within, folder))


def write_scene(path: Path, unit: str | None, units: str | None, within: float | None, target: Path) -> None:
    """Write a scene for a geometry file; collective.

    Raises:
        SceneError: the target exists already, or does not end in .toml.
        MachineError: it cannot be written.
    """
    raise_together(MPI.COMM_WORLD, lambda: _write(path, unit, units, within, target))


def stem(path: Path) -> str:
    """Name of a geometry file without its ending.

    >>> stem(Path("a/pump.v2.step.gz"))
    'pump.v2'
    """
    return Path(path.name.removesuffix(".gz")).stem


def found_in(source: str, unit: str | None, units: str | None, within: float | None) -> proposal.Assembly:
    """The pairs of a geometry file, or of a scene's file."""
    if within is not None and not 0 <= within < np.inf:
        raise SceneError(f"--within {within}: must be a number that is not negative")
    path = Path(source)
    if kind_of(path) is not None:
        return proposal.assembly(path, unit, within, units or "SI")
    if unit is not None:
        raise SceneError(f"--unit {unit}: a scene has its own, geometry.length_unit")
    if units is not None:
        raise SceneError(f"--units {units}: a scene has its own, units")
    model, geometry, of = read_geometry(source)
    if not isinstance(geometry, UserFile):
        raise SceneError(
            f"{source}: a builder's bodies touch at the sides that the docs name; expected a geometry file"
        )
    with named(source):
        return proposal.from_geometry(find(source), geometry, model, of, within)


def _list(source: str, unit: str | None, units: str | None, within: float | None, folder: Path | None) -> None:
    folder = folder or Path(f"{stem(Path(source))}_contacts")
    listed = marker_of(folder).names
    if folder.exists() and not (is_marked(folder) and listed and all(map(PICTURE.fullmatch, listed))):
        raise FolderError(f"{folder}: exists already, and not from here; choose another folder with -o")
    found, out = found_in(source, unit, units, within), console(160)
    names, word = proposal.side_names(found), FACET_WORD[found.dim]
    out.print(f"{len(found.outline.bodies)} bodies, {len(found.pairs)} pairs of sides that touch or nearly do")
    for (one, other), faces in joined(found.outline).items():
        at = f"{word} {', '.join(map(str, faces))}"
        out.print(f"{one} and {other} are joined at {at}: no contact can open there unless you {apart(found.path)}")
    for overlap in found.geometry.overlaps(found.dim):
        out.print(overlap.said(found.units.length), soft_wrap=True)
    words = ("pair", "kind", "side", f"{word}s", "against", f"{word}s")
    sizes = map(found.units.label, ("area [m²]" if found.dim == 3 else "length [m]", "gap [m]", "overlap [m]"))
    table = table_of((*words, *sizes, "proposed"), (), (*words, "proposed"))
    for k, pair in enumerate(found.pairs, start=1):
        row = [str(k), pair.kind]
        for side in (pair.one, pair.other):
            row += [names[side], ", ".join(map(str, side.numbers))]
        low, high = (pair.fit, pair.fit) if pair.exact else pair.gap
        gap = f"{max(0.0, low):.3g}" + (f" to {high:.3g}" if high > max(0.0, low) else "")
        # accuracy of a gap relative to it, from which on it is said
        if not pair.exact and pair.accuracy > SLIGHT * max(-low, high):
            gap += f" ± {pair.accuracy:.1g}"
        table.add_row(*row, f"{pair.area:.3g}", gap, f"{max(0.0, -low):.3g}", proposal.proposed_law(pair, found)[0])
    if found.pairs:
        print_table(table, out)
        _draw(found, folder)
        out.print(f"drawn in {folder}/")


def _draw(found: proposal.Assembly, folder: Path) -> None:
    """Draw each pair, and put the pictures in place of earlier ones when all are there; only here VTK is imported."""
    from stickslip.workflows.pictures.sides import draw_pair

    names = proposal.side_names(found)
    aside = folder.with_name(f".{folder.name}.part")
    with disk_errors(folder):
        shutil.rmtree(aside, ignore_errors=True)  # of a run that was killed
        aside.mkdir(parents=True)
        try:
            for k, pair in enumerate(found.pairs, start=1):
                sides = names[pair.one], names[pair.other]
                draw_pair(aside / f"{k:02d}_{pair.one.body}_{pair.other.body}.png", found.outline, pair, sides)
            drawn = sorted(path.name for path in aside.iterdir())
            folder.mkdir(exist_ok=True)
            declare(folder, drawn)
        except BaseException:
            shutil.rmtree(aside, ignore_errors=True)
            raise
        for name in {*marker_of(folder).names} - {*drawn}:
            (folder / name).unlink(missing_ok=True)
        mark(folder, names=drawn)
        for name in drawn:
            (aside / name).replace(folder / name)
        aside.rmdir()


def _write(path: Path, unit: str | None, units: str | None, within: float | None, target: Path) -> None:
    if kind_of(path) is None:
        raise SceneError(f"--from {path}: expected a geometry file: one of {', '.join(KINDS)}")
    refuse_name(target)
    if target.exists():
        raise SceneError(f"{target}: exists already; choose another name")
    found = found_in(str(path), unit, units, within)
    text = proposal.scene_text(found, target, units or "SI")
    write_new(target, text)
    out = console(160)
    contacts = (
        f"{len(found.pairs)} pairs of sides in one contact" if "between = " in text else f"{len(found.pairs)} contacts"
    )
    out.print(f"wrote {target}: {len(found.outline.bodies)} bodies, {contacts}")
    for overlap in found.geometry.overlaps(found.dim):
        out.print(f"warning: {overlap.said(found.units.length)}", soft_wrap=True)
    out.print(f"change what holds and loads it, then solve it with: stickslip run {target}", soft_wrap=True)


def refuse_name(path: Path) -> None:
    """Check the name of a scene file that is to be made: one such as `block` would hide a ready scene.

    Raises:
        SceneError: it does not end in .toml.
    """
    if path.suffix != ".toml":
        raise SceneError(f"{path}: expected a name that ends in .toml, for the scene that is written")


def write_new(path: Path, text: str) -> None:
    """Write a scene file that is not there yet.

    Raises:
        SceneError: it is there.
        MachineError: disk full, no permission.
    """
    if os.path.lexists(path):
        raise SceneError(f"{path}: cannot be written: {os.strerror(errno.EEXIST)}")
    write_output(path, text.encode())
