"""Reads a scene from a TOML file: registries list the tables that exist, pydantic checks types."""

from __future__ import annotations

import math
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from stickslip.geometry.builders import Builder
from stickslip.geometry.errors import FolderError, GeometryError, Mistakes, SceneError, nearest, require, shortened
from stickslip.geometry.keys import adapter, parse, type_hints, typed
from stickslip.geometry.shape import Model
from stickslip.geometry.units import SI, Units
from stickslip.geometry.user_files.open_file import kind_of
from stickslip.geometry.user_files.user_file import WITH_PARAMETERS, UserFile, installed
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.method_registry import Solver
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.scene.settings import Solver as Settings
from stickslip.workflows.writers.writer import added_keys

LARGEST = 20_000_000  # characters of a scene file
WORD = re.compile(r"[^\[\]{}\"',]*")  # a value of --set that may be a text without quotes
SHORT = re.compile(r"[+-]?(\.\d+|\d+\.)([eE][+-]?\d+)?")  # numbers that TOML wants with a digit more
AXES = "xyz"
DEEPEST = 20  # tables and lists within each other
LACKS = re.compile(r"(?P<table>\w+)\.(?P<name>\w+)\.(?P<key>[\w./ ]+): missing")
Names = Mapping[str, Sequence[str]]  # of what each table of a scene holds
REQUIRED = ("model", "geometry", "bodies")
READY = Path(__file__).parents[1] / "scenes"
TOKEN = re.compile(  # a text, a comment, a bracket or an end of line, or what lies between
    r'''"""(?:\\.|[^\\])*?"{3,5}|"(?:\\.|[^"\\\n])*"|'{3}.*?'{3,5}|'[^'\n]*'|#[^\n]*|[^"'#\[\]{}\n]+|.''', re.DOTALL
)
KEY = re.compile(r"[^\s:=]+")  # at the beginning of a message


@typed
def read(source: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file, or a ready scene by name.

    Args:
        source: path of a TOML file, or the name of a ready scene.
        overrides: `KEY=VALUE` with a dotted key and a TOML value, as `--set` takes them.

    Returns:
        The scene: frozen, checked, with every default filled in; nothing is meshed.

    Raises:
        SceneError: the file, keys or values are wrong; a line for each names it and what is expected.
        GeometryError: the geometry's file is wrong.
    """
    path, data, own = _load(source, overrides)
    with named(path, overrides), _of_new_names(own):
        return from_dict(data, path.parent)


def read_geometry(source: str | Path, overrides: Sequence[str] = ()) -> tuple[Model, Builder | UserFile, Units]:
    """Read only model, geometry and units of a scene, whose other tables may be incomplete.

    Raises:
        SceneError: either of the two is wrong or missing.
    """
    path, data, _ = _load(source, overrides)
    with named(path, overrides), _worded(data):
        _refuse_odd_values(data)
        for key in ("model", "geometry"):
            if key not in data:
                raise SceneError(f"{key}: missing, every scene needs it")
        kind, table = _geometry(data["geometry"], path.parent)
        model: Model = parse(kinds_of_keys()["model"], data["model"], ("model",))
        units = Units.of(parse(kinds_of_keys()["units"], data.get("units", "SI"), ("units",)))
        return model, parse(kind, table, ("geometry",)).measured_in(units), units


def _load(source: str | Path, overrides: Sequence[str]) -> tuple[Path, dict[str, Any], Names]:
    """The scene file's path, what it holds with the overrides, and the names in its own tables."""
    path = find(source)
    if kind_of(path) is not None:
        said = shortened(path)
        raise SceneError(f"{said}: is a geometry file; for a scene: stickslip new --from {shlex.quote(said)}")
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST + 1).decode("utf-8-sig")  # editors of Windows put a mark in front
    except UnicodeDecodeError:
        raise SceneError(f"{shortened(path)}: is not a text file, and a scene is one, in UTF-8") from None
    except OSError as error:
        raise SceneError(f"{shortened(path)}: cannot be read: {shortened(error)}") from None
    if len(text) > LARGEST:
        raise SceneError(f"{shortened(path)}: is longer than {LARGEST // 10**6} million characters, no scene is")
    try:
        data = _toml(text)
    except ValueError as error:
        raise SceneError(f"{shortened(path)}: not valid TOML: {shortened(error)}") from None
    own = _names(data)
    with named(path):
        for override in overrides:
            _override(data, override)
    return path, data, own


def _names(data: Mapping[str, Any]) -> Names:
    return {table: list(value) for table, value in data.items() if isinstance(value, Mapping)}


@contextmanager
def _of_new_names(own: Names) -> Iterator[None]:
    """Context in which a table that an override begins, and that lacks keys, is taken for a misspelt name.

    Args:
        own: the names before the overrides.
    """
    try:
        yield
    except SceneError as error:
        lacking: dict[str, list[str]] = {}
        for line in error.lines:
            found = LACKS.match(line)
            if found and own.get(found["table"]) and found["name"] not in own[found["table"]]:
                lacking.setdefault(f"{found['table']}.{found['name']}", []).append(found["key"])
        if not lacking:
            raise
        lines = [line for line in error.lines if not line.startswith(tuple(f"{key}." for key in lacking))]
        for key, keys in lacking.items():
            table, _, name = key.partition(".")
            direct = ", ".join(each for each in keys if "." not in each)  # a table in it tells of itself alone
            new = f" (a new one needs {direct})" if direct else ""
            lines.append(f"{key}: there is none in the scene{new}; {nearest(name, own[table])}")
        raise SceneError(*lines) from None


@contextmanager
def named(source: str | Path, overrides: Sequence[str] = ()) -> Iterator[None]:
    """Context that puts the name of the scene file, and the line of the key, in front of errors of the scene.

    Args:
        overrides: those of `read`; their keys stand in no line.
    """
    try:
        yield
    except FolderError:
        raise
    except (SceneError, GeometryError) as error:
        path = find(source)
        where = located(error.lines, path, [override.partition("=")[0].strip() for override in overrides])
        raise type(error)(*(f"{path.name}{f':{line}' if line else ''}: {text}" for line, text in where)) from None


def find(source: str | Path) -> Path:
    """Path of a scene file, or of a ready scene by name.

    Raises:
        SceneError: there is no such file or ready scene.
    """
    path, said = Path(source), shortened(source)
    ready = {p.stem: p for p in READY.glob("*.toml")}
    try:
        if path.is_file():
            return path
        if path.is_dir() and str(source) not in ready:  # a ready scene's results have its name now and then
            raise SceneError(f"{said}: is a folder; name a scene file")
    except OSError as error:  # such as a name that is too long
        raise SceneError(f"{said}: cannot be read: {error.strerror}") from None
    if str(source) in ready:
        return ready[str(source)]
    raise SceneError(f"{said}: no such file, nor a ready scene; {nearest(str(source), ready)}")


def title_of(path: Path) -> str:
    """Title of a scene file; its geometry file may be missing."""
    return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))


def kinds_of_keys() -> dict[str, Any]:
    """Type of every key of a scene; [solver] has the keys of all methods."""
    return {**type_hints(Scene), "solver": Solver}


def from_dict(data: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Validate parsed TOML; `folder` is where relative paths of files begin, by default the working folder.

    Raises:
        SceneError: of each mistake key, what was found, what is expected, the nearest valid name.
    """
    with _worded(data):
        return _from_dict(data, folder or Path())


@contextmanager
def _worded(data: Mapping[str, Any]) -> Iterator[None]:
    """Context in which refusals of numbers have the units of the scene, if it has such."""
    try:
        yield
    except FolderError:
        raise
    except (SceneError, GeometryError) as error:
        try:
            units = Units.of(str(data.get("units", "SI")))
        except SceneError:
            units = SI
        raise type(error)(*map(units.refusal, error.lines)) from None


def _from_dict(data: Mapping[str, Any], folder: Path) -> Scene:
    _refuse_odd_values(data)
    mistakes = Mistakes()
    sections = {effect.name: effect.table for effect in EFFECTS if effect.table is not None}
    core = {key: value for key, value in data.items() if key not in sections}
    known = {f.name for f in fields(Scene)} - {"sections"}
    kinds = kinds_of_keys()
    values: dict[str, Any] = {"sections": {}}
    for key, value in core.items():
        with mistakes:
            if key not in known:
                raise SceneError(f"{key}: unknown key; {nearest(key, known | set(sections))}")
            if key == "geometry":
                kinds[key], value = _geometry(value, folder)
            values[key] = _output(value) if key == "output" else parse(kinds[key], _beside(folder, value), (key,))
    for key in [key for key in data if key in sections]:
        with mistakes:
            values["sections"][key] = parse(sections[key], _beside(folder, data[key]), (key,))
    for key in [key for key in REQUIRED if key not in core]:
        with mistakes:
            raise SceneError(f"{key}: missing, every scene needs it")
    mistakes.report()
    return Scene(**values)


def _geometry(table: Any, folder: Path) -> tuple[Any, Any]:
    """Kind of a geometry (builder or file), and its table with an absolute path and unknown keys as parameters."""
    if not isinstance(table, Mapping) or "file" not in table:
        if isinstance(table, Mapping) and "builder" not in table:
            raise SceneError("geometry: needs either builder or file; both are missing")
        return Builder, table
    if "builder" in table:
        raise SceneError("geometry: has both builder and file; keep one of the two")
    known = {f.name for f in fields(UserFile)} - {"scene_length"}
    path = installed(folder / str(table["file"]))
    free = {key: value for key, value in table.items() if key not in known}
    if kind_of(path) in WITH_PARAMETERS and isinstance(table.get("parameters", {}), Mapping):
        table = {key: value for key, value in table.items() if key in known}
        table["parameters"] = {**table.get("parameters", {}), **free}
    elif free:
        key = min(free)
        raise SceneError(f"geometry.{key}: unknown key; {nearest(key, known)}")
    return UserFile, {**table, "file": str(path.absolute()) if isinstance(table["file"], str) else table["file"]}


def _beside(folder: Path, value: Any) -> Any:
    """The value of a key with the paths of CSV files beginning in a folder."""
    if isinstance(value, list):
        return [_beside(folder, item) for item in value]
    if not isinstance(value, Mapping):
        return value
    table = {key: _beside(folder, item) for key, item in value.items()}
    return {**table, "csv": str(folder / table["csv"])} if isinstance(table.get("csv"), str) else table


def _output(table: Any) -> Output:
    """The table [output]: its own keys, and those that writers add; writers' keys at their default are left out."""
    added, own = added_keys(), {f.name for f in fields(Output)} - {"writers"}
    if not isinstance(table, Mapping):
        table = parse(dict[str, Any], table, ("output",))  # says that a table is expected
    mistakes = Mistakes()
    for key in table:
        with mistakes:
            if key not in own and key not in added:
                raise SceneError(f"output.{key}: unknown key; {nearest(key, own | set(added))}")
    mistakes.report()
    found: dict[str, Any] = {}
    for kind in dict.fromkeys(added.values()):
        said = [f.name for f in fields(kind) if f.name in table]
        keys, default = parse(kind, {key: table[key] for key in said}, ("output",)), kind()
        found |= {key: getattr(keys, key) for key in said if getattr(keys, key) != getattr(default, key)}
    output: Output = parse(Output, {key: value for key, value in table.items() if key in own}, ("output",))
    return replace(output, writers=found)


def to_dict(scene: Scene) -> dict[str, Any]:
    """The scene as plain data, every default filled in; `from_dict` reads it back."""
    hints = kinds_of_keys() | {"geometry": type(scene.geometry)}
    plain = {
        f.name: adapter(hints[f.name]).dump_python(
            getattr(scene, f.name), mode="json", by_alias=True, exclude_none=True
        )
        for f in fields(Scene)
        if f.name != "sections"
    }
    plain["output"] |= plain["output"].pop("writers")
    for effect in EFFECTS:
        if effect.name in scene.sections:
            table = scene.sections[effect.name]
            plain[effect.name] = adapter(effect.table).dump_python(table, mode="json", by_alias=True)
    return plain


def with_keys(scene: Scene, values: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """The scene with other values of keys, dotted as in `--set`; it is judged when all are put.

    Args:
        folder: where relative paths of files begin, by default the working folder.

    Raises:
        SceneError: an unknown key, or a value that it refuses.
    """
    data = to_dict(scene)
    own = _names(data)
    for key, value in values.items():
        _put(data, key, value, key)
    with _of_new_names(own):
        return from_dict(data, folder)


def with_method(solver: Settings, words: str) -> Settings:
    """[solver] with another method, given as NAME or NAME+KEY=VALUE+KEY=VALUE with some of its keys.

    Raises:
        SceneError: an unknown key, or a value that it refuses.
    """
    name, *keys = words.split("+")
    table = adapter(Solver).dump_python(solver, mode="json", by_alias=True, exclude_none=True) | {"method": name}
    for key in keys:
        _override(table, key)
    found: Settings = parse(Solver, table, ("solver",))
    return found


def _refuse_odd_values(value: Any, path: tuple[str, ...] = ()) -> None:
    """Refuse what no key of a scene can be: numbers that are not finite or too long, tables in tables without end.

    Raises:
        SceneError: key, value, what is expected.
    """
    key = ".".join(path)
    require(len(path) <= DEEPEST, shortened(key), "[...]", f"tables and lists more than {DEEPEST} deep")
    if isinstance(value, float) and (key, value) != ("output.error_budget", math.inf):
        require(math.isfinite(value), shortened(key), value, "must be a finite number")
    if isinstance(value, int):
        require(abs(value) < 2**63, shortened(key), f"{value:.3g}" if abs(value) < 10**300 else "...", "is too large")
    items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for name, item in items:
        _refuse_odd_values(item, (*path, str(name)))


def _toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises:
        ValueError: it is none; the text of the error is one line.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"brackets more than {DEEPEST} deep") from None
    except ValueError as error:  # also of an integer of thousands of digits
        own = isinstance(error, tomllib.TOMLDecodeError)
        raise ValueError(shortened(error) if own else "a number of thousands of digits") from None


def _override(data: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    said = f"--set {shortened(override)}"
    if not equals or not key.strip():
        raise SceneError(f"{said}: expected KEY=VALUE, for example solver.method=uzawa")
    _put(data, key, value_of(text, said), said)


def value_of(text: str, said: str) -> Any:
    """A value as it stands in a TOML file, or a bare word, or a number such as .5; `said` names it in a refusal."""
    if SHORT.fullmatch(text.strip()):
        return float(text)
    try:
        return _toml(f"value = {text}")["value"]
    except ValueError as error:
        if not WORD.fullmatch(text.strip()):
            raise SceneError(f"{said}: not a value as in TOML: {error}") from None
        return text


def _put(data: dict[str, Any], key: str, value: Any, said: str) -> None:
    """Put the value of a dotted key; `said` names it in a refusal."""
    *tables, last = key.strip().split(".")
    require(len(tables) < DEEPEST, said, "[...]", f"tables more than {DEEPEST} deep")
    found: Any = data
    for depth, table in enumerate(tables, 1):
        found = found.setdefault(table, {}) if isinstance(found, dict) else None
        if isinstance(found, list) and last in AXES[: len(found)] and depth == len(tables):
            found[AXES.index(last)] = value  # of a vector that is given as a list
            return
        if not isinstance(found, dict):
            raise SceneError(f"{said}: {shortened(table)} is not a table")
    found[last] = value


def located(messages: Sequence[str], path: Path, but: Sequence[str] = ()) -> list[tuple[int | None, str]]:
    """Each message that begins with a dotted key, with the line of that key, or of the table that lacks it; by lines.

    Args:
        but: keys that come from elsewhere.
    """
    try:
        lines = lines_of_keys(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):  # the message says it
        lines = {}
    found = [(_line(message, lines, but), message) for message in messages]
    return sorted(found, key=lambda each: each[0] or 0)


def _line(message: str, lines: dict[str, int], but: Sequence[str]) -> int | None:
    words = KEY.match(message)
    key = words[0] if words else ""
    while key:
        if any(f"{key}.".startswith(f"{other}.") for other in but):
            return None
        if key in lines:
            return lines[key]
        key = key.rpartition(".")[0]
    return None


def lines_of_keys(text: str) -> dict[str, int]:
    """Line of each dotted key and table of a text that is TOML; keys in one value are all in the line of its beginning.

    >>> lines_of_keys('a = 1\\n[b.c]  # [d]\\nx = [\\n1,\\n2]\\ny = {z = 3}')
    {'a': 1, 'b': 2, 'b.c': 2, 'b.c.x': 3, 'b.c.y': 6, 'b.c.y.z': 6}
    """
    found: dict[str, int] = {}
    table: tuple[str, ...] = ()
    for line, statement in _statements(text):
        paths, head = list(_paths(tomllib.loads(statement))), statement.lstrip().startswith("[")
        for path in paths:
            found.setdefault(".".join(path if head else (*table, *path)), line)
        table = paths[-1] if head else table
    return found


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Line and text of each table's head and each `key = value`, which goes on while a bracket is open."""
    begin, line, depth, parts = 1, 1, 0, list[str]()
    for word in (found[0] for found in TOKEN.finditer(f"{text}\n")):
        depth += (word in "[{") - (word in "]}")
        if word == "\n" and depth == 0:
            if parts:
                yield begin, "".join(parts)
            parts = []
        elif not word.startswith("#") and (parts or not word.isspace()):
            begin = begin if parts else line
            parts.append(word)
        line += word.count("\n")


def _paths(value: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """All keys in what a statement says, a table before what it holds."""
    for name, item in value.items() if isinstance(value, dict) else ():
        yield (*above, name)
        yield from _paths(item, (*above, name))
