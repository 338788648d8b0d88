"""Datasets of an HDF5 file, and what it has in other files: a file may name any other one of the user's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from stickslip.geometry.errors import GeometryError, shortened


def datasets(file: Any) -> dict[str, Any]:
    """Return the low-level datasets of an open HDF5 file by name; None: it has that in another file."""
    found: dict[str, Any] = {}

    def look(name: bytes, link: Any) -> None:
        item: Any = h5py.h5o.open(file.id, name) if link.type == h5py.h5l.TYPE_HARD else None
        if isinstance(item, h5py.h5d.DatasetID):
            stored = item.get_create_plist()
            outside = stored.get_external_count() or stored.get_layout() == h5py.h5d.VIRTUAL
            found[name.decode(errors="replace")] = None if outside else item
        elif link.type == h5py.h5l.TYPE_EXTERNAL:
            found[name.decode(errors="replace")] = None

    file.id.links.visit(look, info=True)
    return found


def elsewhere(file: Any) -> str:
    """Return the name of what it has in other files: by a link, external or virtual storage; or nothing."""
    return next((name for name, item in datasets(file).items() if item is None), "")


def refuse_others(path: Path) -> None:
    """
    Raises:
        GeometryError: a file of HDF5 has numbers in other files.
    """
    with h5py.File(path) as file:
        if name := elsewhere(file):
            raise GeometryError(f"has {shortened(name)} in another file; a mesh of one file is needed")
