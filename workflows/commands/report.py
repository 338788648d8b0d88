"""stickslip report: pages of results that are there."""

from __future__ import annotations

from pathlib import Path

from stickslip.geometry.errors import FolderError, SceneError
from stickslip.workflows.commands.process import speaks
from stickslip.workflows.pictures.report_page import NAME, write_report
from stickslip.workflows.pictures.report_results import Results, read_results
from stickslip.workflows.run.folder import BEGUN, RESULT, work_of


def report(folder: Path, path: Path | None) -> Path:
    """Write the page of a results folder, by default into it; that of a run without an end is found as well.

    Raises:
        FolderError: there are no results.
        SceneError: a folder stands where the page is to be.
    """
    results = found(folder)
    path = path or results.folder / NAME
    if path.is_dir():
        raise SceneError(f"{path}: is a folder; name a file for the page with -o")
    return write_report(results, path) if speaks() else path


def found(folder: Path) -> Results:
    """The results that stand there, or those of the run that was to leave them there.

    Raises:
        FolderError: there are none.
    """
    if not folder.is_dir() and not work_of(folder).is_dir():
        raise FolderError(f"{folder}: no such folder")
    places = [place for place in (folder, work_of(folder)) if any((place / name).is_file() for name in (RESULT, BEGUN))]
    return read_results(places[0] if places else folder)
