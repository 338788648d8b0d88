"""`.stickslip`: which files of a results folder are a run's own; only these are ever moved or removed.

The first line is the program's signature; each line after it is the name of a file below the folder, as JSON, written
before the file is made. A folder is listed with a slash at the end. While the files of one folder move to another, a
table says where from, so that whoever comes after a crash goes on moving; another one holds the checksum of
result.json, and one in former results names the folder that they were moved from.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from stickslip.geometry.errors import FolderError, MachineError
from stickslip.workflows.formats.regular import parse_json, read_regular

MARKER = ".stickslip"
SIGNATURE = "stickslip: results of a run; only the files that are listed here are moved or removed by another run\n"
PART = ".stickslip.part"  # of the marker, before it is whole
FROM, CHECKSUM, FORMER = "moving from", "sha256", "former results of"  # keys of tables
LAST = "run.log"  # its lock tells other processes that the files are being moved
DEPTH = 4  # folders below a marked one in which a run writes, and more
_known: dict[tuple[int, int], tuple[int, int, set[str]]] = {}  # names by marker (device, inode), its size and time


class Content(NamedTuple):
    """What a marker says."""

    names: tuple[str, ...]
    source: Path | None  # of files that are being moved
    checksums: dict[str, str]  # sha256 by file
    former: str  # name of the folder whose former results these are; empty: of none


def is_marked(folder: Path) -> bool:
    """Whether the folder is that of a run."""
    return (_text(folder / MARKER) or "").startswith(SIGNATURE)


def mark(folder: Path) -> None:
    """Make the folder one of a run; it stays what it is where it is marked."""
    if not is_marked(folder):
        _write(folder, (), None)


def claim(path: Path, folder: bool = False) -> None:
    """List a file, or a folder, that is about to be made below a marked folder; elsewhere nothing is listed.

    Raises:
        MachineError: what stands there is no file of the run.
    """
    for depth, place in enumerate(path.parents):
        if depth == DEPTH:
            return
        if is_marked(place):
            break
    else:
        return
    name = f"{path.relative_to(place).as_posix()}{'/' if folder else ''}"
    marker = place / MARKER
    about = marker.stat()
    size, time, names = _known.get((about.st_dev, about.st_ino), (-1, -1, set[str]()))
    if (size, time) != (about.st_size, about.st_mtime_ns):
        names = set(listed(place))
    if name not in names:
        if not folder and os.path.lexists(path):
            raise MachineError(f"{path}: is no file of this run, and in its way; move it away")
        _append(marker, name)
        names.add(name)
        about = marker.stat()
    _known[about.st_dev, about.st_ino] = about.st_size, about.st_mtime_ns, names


def listed(folder: Path) -> tuple[str, ...]:
    """Names of the run's own files and folders, those of folders with a slash at the end."""
    return _content(folder).names


def own_files(folder: Path) -> set[Path]:
    """Paths of the run's own files."""
    return {folder / name for name in listed(folder) if not name.endswith("/")}


def has_own(folder: Path) -> bool:
    """Whether a file of a run is there."""
    return any(_is_file(path) for path in own_files(folder))


def former_of(folder: Path) -> str:
    """Name of the folder whose former results these are; empty: of none, or nobody has noted it."""
    return _content(folder).former


def certify(path: Path) -> None:
    """Note the checksum of a file of a marked folder, from which `is_certified` tells later edits."""
    if path.is_file():
        _append(path.parent / MARKER, {CHECKSUM: {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}})


def is_certified(path: Path) -> bool:
    """Whether a file is what it was when it was certified last."""
    try:
        return _content(path.parent).checksums.get(path.name) == hashlib.sha256(read_regular(path)).hexdigest()
    except OSError:
        return False


def strange(folder: Path) -> Path | None:
    """What stands where the run has made a file or a folder, and is a link or of another kind; None: nothing does."""
    names = listed(folder)
    files = {MARKER, *(name for name in names if not name.endswith("/"))}
    places = [(folder / name, _is_file) for name in files]
    places += [(folder / name, _is_folder) for name in {part for name in names for part in _upwards(name)} - files]
    return next((place for place, fits in sorted(places) if os.path.lexists(place) and not fits(place)), None)


def foreign(folder: Path) -> Iterator[Path]:
    """Files, links and folders below it that are not the run's own."""
    names = listed(folder)
    files = {place for name in names if not name.endswith("/") for place in (name, _part(name))} | {MARKER, PART}
    folders = {part for name in names for part in _upwards(name)} - files
    for place, inner, outer in os.walk(folder):
        for name in (*inner, *outer):
            path = Path(place) / name
            known = folders if name in inner and not path.is_symlink() else files
            if path.relative_to(folder).as_posix() not in known or path.is_symlink():
                yield path


def remove_own(folder: Path, below: str = "", but: str = "") -> None:
    """Remove the run's own files, what folders they leave empty, and the folder itself if nothing is left.

    Args:
        below: a folder in it: only what is listed there is removed.
        but: a file that stays, and with it the folder.
    """
    if not is_marked(folder):
        return
    names, _, checksums, _ = _content(folder)
    gone = [name for name in names if name.startswith(below) and name != but]
    for name in gone:
        for path in (folder / name, folder / _part(name)):
            if _is_file(path):
                path.unlink()
    _remove_empty(folder, gone)
    if below or but:
        stay = [name for name in names if name not in gone]
        _write(folder, stay, None, {name: total for name, total in checksums.items() if name in stay})
    else:
        _end(folder)


def remove_unfinished(folder: Path) -> None:
    """Remove what a crash has left of files that the run was writing."""
    for name in listed(folder):
        if _is_file(folder / _part(name)):
            (folder / _part(name)).unlink()


def move_own(source: Path, target: Path, whole: bool = False, former: str = "") -> None:
    """Move the run's own files from one marked folder to another; by one rename if the second is free.

    Args:
        whole: what else the first holds may go with them.
        former: what the second notes, see `former_of`.

    Raises:
        FolderError: something else is in their way; nothing is moved.
    """
    free = not os.path.lexists(target) or (not target.is_symlink() and not any(target.iterdir()))
    if free and not source.is_symlink() and (whole or next(foreign(source), None) is None):
        if former_of(source) != former:
            with suppress(PermissionError):  # results that may only be read are moved all the same
                _write(source, listed(source), None, _content(source).checksums, former)
        try:
            source.rename(target)
        except OSError as error:
            if error.errno not in (errno.EXDEV, errno.EBUSY):  # another disk, or a place where one is mounted
                raise
        else:
            return
    names, own = listed(source), set(listed(target)) if is_marked(target) else set[str]()
    folders = {part for name in names for part in _upwards(name) if part not in names}
    for place in sorted({part for name in names for part in _upwards(name)}):
        path = target / place
        fits = _is_folder(path) if place in folders else place in own
        if os.path.lexists(path) and not fits:
            raise FolderError(
                f"{path}: is not of a run, and in the way of results, which stay in {source}; move it away, and go on "
                "with --resume"
            )
    os.makedirs(os.path.realpath(target), exist_ok=True)
    _write(target, (*own, *names), source, _content(source).checksums, former)
    go_on_moving(target)


def moving_from(folder: Path) -> Path | None:
    """Where the files of a folder come from whose move is not complete; None: nothing moves."""
    return _content(folder).source if is_marked(folder) else None


def go_on_moving(target: Path) -> None:
    """Move what is still to be moved; nothing if nothing is."""
    names, source, checksums, former = _content(target)
    if source is None:
        return
    for name in sorted(names, key=lambda name: name == LAST):
        place, path = source / name, target / name
        if name.endswith("/"):
            path.mkdir(parents=True, exist_ok=True)
        elif _is_file(place):
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                place.replace(path)
            except OSError as error:
                if error.errno != errno.EXDEV:
                    raise
                shutil.copy2(place, target / _part(name), follow_symlinks=False)
                (target / _part(name)).replace(path)
                place.unlink()
        if _is_file(source / _part(name)):
            (source / _part(name)).unlink()
    _write(target, names, None, checksums, former)
    if source.is_dir():
        _remove_empty(source, names)
        _end(source)


def _end(folder: Path) -> None:
    """The folder holds no file of a run any more: it goes if it holds nothing else, and stays a run's if it does."""
    if (
        folder.is_symlink()
        or os.path.ismount(folder)
        or any(path.name not in (MARKER, PART) for path in folder.iterdir())
    ):
        _write(folder, (), None)
    else:
        for name in (MARKER, PART):
            (folder / name).unlink(missing_ok=True)
        folder.rmdir()


def _remove_empty(folder: Path, names: Iterable[str]) -> None:
    """Remove folders of listed files that are empty, from within."""
    files = {name for name in names if not name.endswith("/")}
    for place in sorted({part for name in names for part in _upwards(name)} - files, key=len, reverse=True):
        if _is_folder(folder / place) and not any((folder / place).iterdir()):
            (folder / place).rmdir()


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _upwards(name: str) -> Iterator[str]:
    """A listed name without slash, and the folders above it.

    >>> list(_upwards("steps/000001.h5"))
    ['steps/000001.h5', 'steps']
    """
    path = PurePosixPath(name)
    yield path.as_posix()
    yield from (above.as_posix() for above in path.parents if above.name)


def _part(name: str) -> str:
    """Name under which a file is written before it is whole.

    >>> _part("steps/000001.h5")
    'steps/.000001.h5.part'
    """
    path = PurePosixPath(name)
    return path.with_name(f".{path.name}.part").as_posix()


def _content(folder: Path) -> Content:
    """A line that is cut short, or is no name of a file below the folder, lists nothing."""
    names, source, checksums, former = dict[str, None](), None, dict[str, str](), ""
    for line in (_text(folder / MARKER) or "").removeprefix(SIGNATURE).splitlines(keepends=True):
        try:
            said = parse_json(line.encode()) if line.endswith("\n") else None
        except ValueError:
            continue
        if isinstance(said, str) and _is_below(said):
            names[said] = None
        elif isinstance(said, dict) and isinstance(said.get(FROM), str):
            source = Path(os.path.normpath(folder / said[FROM]))
        elif isinstance(said, dict) and isinstance(said.get(CHECKSUM), dict):
            checksums |= said[CHECKSUM]
        elif isinstance(said, dict) and isinstance(said.get(FORMER), str):
            former = said[FORMER]
    return Content(tuple(names), source, checksums, former)


def _is_below(name: str) -> bool:
    parts = PurePosixPath(name).parts
    return (
        bool(parts)
        and not name.startswith("/")
        and ".." not in parts
        and "\0" not in name
        and parts[0] not in (MARKER, PART)
    )


def _text(marker: Path) -> str | None:
    """Of a marker; None where there is none."""
    try:
        return read_regular(marker).decode(errors="replace")
    except OSError:
        return None


def _append(marker: Path, said: str | dict[str, Any]) -> None:
    descriptor = os.open(marker, os.O_RDWR | os.O_APPEND)  # ranks on several machines may append
    with os.fdopen(descriptor, "r+b") as file:
        torn = not file.read().endswith(b"\n")  # by a crash
        file.write(b"\n" * torn + json.dumps(said).encode() + b"\n")
        file.flush()
        os.fsync(descriptor)


def _write(
    folder: Path,
    names: Iterable[str],
    source: Path | None,
    checksums: Mapping[str, str] | None = None,
    former: str = "",
) -> None:
    lines = [json.dumps(name) for name in dict.fromkeys(names)]
    if source is not None:
        lines.append(json.dumps({FROM: os.path.relpath(source, folder)}))
    if checksums:
        lines.append(json.dumps({CHECKSUM: dict(checksums)}))
    if former:
        lines.append(json.dumps({FORMER: former}))
    aside = folder / PART
    with aside.open("wb") as file:
        file.write((SIGNATURE + "".join(f"{line}\n" for line in lines)).encode())
        file.flush()
        os.fsync(file.fileno())
    aside.replace(folder / MARKER)
