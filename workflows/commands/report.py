"""stickslip report: pages of results that are there."""

from __future__ import annotations

from pathlib import Path

from stickslip.geometry.errors import SceneError
from stickslip.workflows.commands.process import speaks
from stickslip.workflows.pictures.report_page import NAME, write_report
from stickslip.workflows.run.load import found


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
