"""`.stickslip` marks the folder of a run, and says once which files in it the run makes; all others are the user's.

Its first line is the program's signature, its second one JSON: names of files below the folder, written before the
first of them is made. A name that ends with a slash is a folder, whose files are the run's where their own names are
those of a step's files, as steps/000012.h5. Beside them stand, once the run has ended, the checksums of the files that
are read again, and in former results the name of the folder that they were in before.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import DamagedError, FolderError, MachineError, SceneError
from stickslip.workflows.formats.files import parse_json, read_regular, write_aside

MARKER, PART = ".stickslip", "..stickslip.part"  # and the marker before it is whole
SIGNATURE = "stickslip: results of a run;"
HEAD = f"{SIGNATURE} the files that are named here are the run's, all others the user's\n"
RESULT = "result.json"  # of a run that has ended
LOG = "run.log"  # of every run; its lock tells other processes that one is at work
OF_STEP = re.compile(  # names of files that a run makes for a step
    r"[0-9]{6}((\.light)?\.h5|\.[0-9]+\.bin|\.hdf5|\.vtm|_(body|contact)_\w+\.vtu)"
)
READ_AGAIN = re.compile(rf"{re.escape(RESULT)}|[^/]+\.(csv|h5|png)|steps/.+\.h5")  # they get a checksum at the end
USER_BLOCK = 512  # bytes of an HDF5 file, in which it says the checksum of all that follows
UNFINISHED = re.compile(r"\.(.+)\.part")  # name of a file before it is whole


@dataclass(frozen=True, kw_only=True)
class Marker:
    """Content of the marker of a folder."""

    names: tuple[str, ...] = ()  # of the run's files and, with a slash at the end, of its folders
    sha256: dict[str, str] = field(default_factory=dict)  # by file; behind a space its size
    former: str = ""  # name of the folder whose former results these are; empty: of none, or nobody has noted it

    def owns(self, name: str) -> bool:
        """Return whether a file of this name below the folder is one of the run's.

        >>> names = "steps/000001.h5", "steps/.000001.h5.part", "steps/000001.txt", "a.csv"
        >>> [Marker(names=("steps/",)).owns(name) for name in names]
        [True, True, False, False]
        """
        folder, slash, last = name.rpartition("/")
        if part := UNFINISHED.fullmatch(last):
            return self.owns(f"{folder}{slash}{part[1]}")
        return name in (MARKER, LOG, *self.names) or bool(f"{folder}/" in self.names and OF_STEP.fullmatch(last))

    def makes_folder(self, name: str) -> bool:
        """Return whether a folder of this name is made for files of the run."""
        return any(each.startswith(f"{name}/") for each in self.names)


def is_marked(folder: Path) -> bool:
    """Return whether the folder is that of a run."""
    return text_of(folder / MARKER).startswith(SIGNATURE)


def marker_of(folder: Path) -> Marker:
    """Return what the marker says; one that is damaged names nothing."""
    try:
        said = parse_json(text_of(folder / MARKER).partition("\n")[2].encode())
        names, sha256, former = tuple(said["names"]), dict(said["sha256"]), said["former"]
    except (ValueError, TypeError, KeyError):
        return Marker()
    below = tuple(name for name in names if isinstance(name, str) and name)
    sums = {name: total for name, total in sha256.items() if isinstance(total, str)}
    return Marker(names=below, sha256=sums, former=former if isinstance(former, str) else "")


def mark(folder: Path, **said: Any) -> None:
    """Make the folder one of a run, or change what its marker says; the new marker is there whole or not at all."""
    text = json.dumps(asdict(replace(marker_of(folder), **said)))
    write_aside(folder / MARKER, f"{HEAD}{text}\n".encode())


def declare(folder: Path, names: Iterable[str]) -> None:
    """Say which files a run will make in its marked folder.

    Raises:
        FolderError: a file of the user has such a name.
    """
    marker = marker_of(folder)
    new = [name for name in dict.fromkeys(names) if name not in marker.names]
    for name in new:
        if not name.endswith("/") and os.path.lexists(folder / name):
            raise FolderError(f"{folder / name}: is no file of this run, and in its way; move it away")
    if new:
        mark(folder, names=(*marker.names, *new))


def refuse_place(path: Path, what: str) -> None:
    """Refuse a folder, or a file of a run, as the place of another output.

    Args:
        what: that is written, in a word.

    Raises:
        SceneError: it is one.
    """
    if path.is_dir():
        raise SceneError(f"{path}: is a folder; name a file for the {what} with -o")
    if is_marked(path.parent) and marker_of(path.parent).owns(path.name):
        raise FolderError(f"{path}: is a file of that run; choose another name with -o")


def certify(folder: Path, *names: str) -> None:
    """Note the checksums of files of a marked folder, by default of all that are read again; later edits are then told.

    Args:
        names: of files that were written again.
    """
    below = names or sorted(path.relative_to(folder).as_posix() for path in own_files(folder))
    sums = {name: _sum(folder / name) for name in below if READ_AGAIN.fullmatch(name)}
    mark(folder, sha256=marker_of(folder).sha256 | sums)


def checksums(folder: Path) -> Mapping[str, str]:
    """Return checksum and size of files of a run that has ended; what another one has left may still grow."""
    return marker_of(folder).sha256 if os.path.lexists(folder / RESULT) else {}


def is_certified(path: Path) -> bool:
    """Return whether a file below a marked folder is what it was when it was certified."""
    try:
        return path.name in marker_of(path.parent).sha256 and bool(read_checked(path))
    except MachineError:
        return False


def read_checked(path: Path) -> bytes:
    """Return the content of a file; one of a run that has ended must be what the run has left there.

    Raises:
        DamagedError: it is shorter.
        MachineError: it cannot be read; or it was changed, or is another file.
    """
    try:
        content = read_regular(path)
    except OSError as error:
        raise MachineError(f"{path}: cannot be read: {error.strerror or error}") from error
    folder, total = path.parent if is_marked(path.parent) else path.parent.parent, _sum(path, content)
    sums = checksums(folder)
    digest, _, size = sums.get(path.relative_to(folder).as_posix(), "").partition(" ")
    if digest in ("", total.split()[0]):
        return content
    if other := next((name for name, each in sums.items() if each == total), None):
        raise MachineError(f"{path}: is not that file: it is what {other} was when the run ended")
    if size.isdigit() and len(content) < (USER_BLOCK if path.suffix == ".h5" else int(size)):
        raise DamagedError(f"{path}: damaged: cut short or changed after the run, from {size} to {len(content)} bytes")
    raise MachineError(f"{path}: was changed after the run, or is of another one")


def read_checked_json(path: Path) -> dict[str, Any]:
    """Return the table in a JSON file, see `read_checked`.

    Raises:
        DamagedError: it holds none.
    """
    try:
        return dict(parse_json(read_checked(path)))
    except (TypeError, ValueError):
        raise DamagedError(f"{path}: damaged or cut short: it is no table of JSON") from None


def _sum(path: Path, content: bytes | None = None) -> str:
    """Return checksum and size of a file; of HDF5 that of the block in which it says its own."""
    start = read_regular(path, USER_BLOCK if path.suffix == ".h5" else -1) if content is None else content
    size = path.stat().st_size if content is None else len(content)
    digest = hashlib.sha256(start[:USER_BLOCK] if path.suffix == ".h5" else start).hexdigest()
    return f"{digest} {size}"


def entries(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Yield all that lies below a folder, what is deepest first, each with whether the run makes something there."""
    marker = marker_of(folder)
    for place, folders, files in os.walk(folder, topdown=False):
        for name in (*files, *folders):
            path = Path(place) / name
            below = path.relative_to(folder).as_posix()
            yield path, marker.owns(below) or marker.makes_folder(below)


def own_files(folder: Path) -> list[Path]:
    """Return the files that a run has made, but for its marker."""
    return [path for path, own in entries(folder) if own and is_file(path) and path.name not in (MARKER, PART)]


def strange(folder: Path) -> Path | None:
    """Return what stands where the run makes a file or a folder, and is a link or of another kind; None: nothing is."""
    marker = marker_of(folder)
    for path, own in entries(folder):
        fits = is_folder if marker.makes_folder(path.relative_to(folder).as_posix()) else is_file
        if own and not fits(path):
            return path
    return None


def foreign(folder: Path) -> Iterator[Path]:
    """Yield files, links and folders below it that are not the run's own."""
    return (path for path, own in entries(folder) if not own or path.is_symlink())


def remove_own(folder: Path, but: str = "") -> None:
    """Remove the run's own files and the folders that they leave empty; the folder itself if nothing else is left.

    Args:
        but: a file that stays, and with it the folder and its mark.
    """
    for path, own in entries(folder):
        if own and path not in (folder / MARKER, folder / but):
            if is_folder(path) and not any(path.iterdir()):
                path.rmdir()
            elif is_file(path):
                path.unlink()
    if not but and [path.name for path in folder.iterdir()] in ([], [MARKER]):
        (folder / MARKER).unlink(missing_ok=True)  # last: until here it is a run's
        folder.rmdir()


def remove_unfinished(folder: Path) -> None:
    """Remove what a crash has left of files that the run was writing."""
    for path, own in entries(folder):
        if own and UNFINISHED.fullmatch(path.name) and is_file(path):
            path.unlink()


def is_file(path: Path) -> bool:
    """Return whether it is a regular file, and no link to one."""
    return path.is_file() and not path.is_symlink()


def is_folder(path: Path) -> bool:
    """Return whether it is a folder, and no link to one."""
    return path.is_dir() and not path.is_symlink()


def text_of(path: Path) -> str:
    """Return the text of a file; empty where there is none."""
    try:
        return read_regular(path).decode(errors="replace")
    except OSError:
        return ""
