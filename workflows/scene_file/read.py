"""Reads a scene from a TOML file: registries list the tables that exist, pydantic checks types."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from geometry.builders import Builder
from geometry.errors import FolderError, GeometryError, SceneError, nearest
from geometry.keys import Choice
from geometry.shape import Model
from geometry.user_files.open_file import kind_of
from geometry.user_files.user_file import WITH_PARAMETERS, UserFile
from solvers.effects import EFFECTS
from solvers.methods import Solver
from solvers.scene.scene import Scene
from solvers.scene.settings import Output
from solvers.scene.settings import Solver as Settings
from workflows.writers.writer import added_keys

READY = Path(__file__).parents[1] / "scenes"
EXPECTED = {  # pydantic speaks of JSON; a user wrote TOML
    "float_type": "expected a number",
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "string_type": "expected a text, in quotes",
    "bool_type": "expected true or false",
    "dict_type": "expected a table",
    "dataclass_type": "expected a table",
    "tuple_type": "expected a list",
}


def read(source: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file, or a ready scene by name.

    Args:
        source: path of a TOML file, or the name of a ready scene.
        overrides: `KEY=VALUE` with a dotted key and a TOML value, as `--set` takes them.

    Returns:
        The scene: frozen, checked, with every default filled in; nothing is meshed.

    Raises:
        SceneError: the file, a key or a value is wrong; one line names it and what is expected.
        GeometryError: the geometry's file is wrong.
    """
    path, data = _load(source, overrides)
    with named(path):
        return from_dict(data, path.parent)


def read_geometry(source: str | Path, overrides: Sequence[str] = ()) -> tuple[Model, Builder | UserFile]:
    """Read only model and geometry of a scene, whose other tables may be incomplete.

    Raises:
        SceneError: either of the two is wrong or missing.
    """
    path, data = _load(source, overrides)
    with named(path):
        _refuse_non_finite(data, ())
        for key in ("model", "geometry"):
            if key not in data:
                raise SceneError(f"{key}: missing, every scene needs it")
        kind, table = _geometry(data["geometry"], path.parent)
        model: Model = _parse(kinds_of_keys()["model"], data["model"], ("model",))
        return model, _parse(kind, table, ("geometry",))


def _load(source: str | Path, overrides: Sequence[str]) -> tuple[Path, dict[str, Any]]:
    """The scene file's path, and what it holds with the overrides."""
    path = find(source)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read: {_one_line(error)}") from None
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not valid TOML: {_one_line(error)}") from None
    with named(path):
        for override in overrides:
            _override(data, override)
    return path, data


@contextmanager
def named(source: str | Path) -> Iterator[None]:
    """Context that puts the name of the scene file in front of errors of the scene."""
    try:
        yield
    except FolderError:
        raise
    except (SceneError, GeometryError) as error:
        raise type(error)(f"{find(source).name}: {error}") from None


def find(source: str | Path) -> Path:
    """Path of a scene file, or of a ready scene by name.

    Raises:
        SceneError: there is no such file or ready scene.
    """
    path = Path(source)
    ready = {p.stem: p for p in READY.glob("*.toml")}
    if path.is_file():
        return path
    if str(source) in ready:
        return ready[str(source)]
    if path.is_dir():
        raise SceneError(f"{source}: is a folder; name a scene file")
    raise SceneError(f"{source}: no such file, nor a ready scene; {nearest(str(source), ready)}")


def title_of(path: Path) -> str:
    """Title of a scene file; its geometry file may be missing."""
    return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))


def kinds_of_keys() -> dict[str, Any]:
    """Type of every key of a scene; [solver] has the keys of all methods."""
    return get_type_hints(Scene, include_extras=True) | {"solver": Solver}


def from_dict(data: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Validate parsed TOML; `folder` is where a relative `geometry.file` begins, by default the working folder.

    Raises:
        SceneError: key, what was found, what is expected, the nearest valid name.
    """
    _refuse_non_finite(data, ())
    sections = {effect.name: effect.table for effect in EFFECTS if effect.table is not None}
    core = {key: value for key, value in data.items() if key not in sections}
    known = {f.name for f in fields(Scene)} - {"sections"}
    for key in core:
        if key not in known:
            raise SceneError(f"{key}: unknown key; {nearest(key, known | set(sections))}")
    kinds = kinds_of_keys()
    if "geometry" in core:
        kinds["geometry"], core["geometry"] = _geometry(core["geometry"], folder or Path())
    values: dict[str, Any] = {"sections": {}}
    for key, value in core.items():
        values[key] = _output(value) if key == "output" else _parse(kinds[key], value, (key,))
    values["sections"] = {key: _parse(sections[key], data[key], (key,)) for key in data if key in sections}
    missing = [key for key in ("model", "geometry", "bodies") if key not in values]
    if missing:
        raise SceneError(f"{missing[0]}: missing, every scene needs it")
    return Scene(**values)


def _geometry(table: Any, folder: Path) -> tuple[Any, Any]:
    """Kind of a geometry (builder or file), and its table with an absolute path and unknown keys as parameters."""
    if not isinstance(table, Mapping) or "file" not in table:
        if isinstance(table, Mapping) and "builder" not in table:
            raise SceneError("geometry: needs either builder or file; both are missing")
        return Builder, table
    if "builder" in table:
        raise SceneError("geometry: has both builder and file; keep one of the two")
    known = {f.name for f in fields(UserFile)}
    path = folder / str(table["file"])
    free = {key: value for key, value in table.items() if key not in known}
    if kind_of(path) in WITH_PARAMETERS and isinstance(table.get("parameters", {}), Mapping):
        table = {key: value for key, value in table.items() if key in known}
        table["parameters"] = {**table.get("parameters", {}), **free}
    elif free:
        key = min(free)
        raise SceneError(f"geometry.{key}: unknown key; {nearest(key, known)}")
    return UserFile, {**table, "file": str(path.absolute()) if isinstance(table["file"], str) else table["file"]}


def _output(table: Any) -> Output:
    """The table [output]: its own keys, and those that writers add; writers' keys at their default are left out."""
    added, own = added_keys(), {f.name for f in fields(Output)} - {"writers"}
    if not isinstance(table, Mapping):
        table = _parse(dict[str, Any], table, ("output",))  # says that a table is expected
    for key in table:
        if key not in own and key not in added:
            raise SceneError(f"output.{key}: unknown key; {nearest(key, own | set(added))}")
    found: dict[str, Any] = {}
    for kind in dict.fromkeys(added.values()):
        said = [f.name for f in fields(kind) if f.name in table]
        keys, default = _parse(kind, {key: table[key] for key in said}, ("output",)), kind()
        found |= {key: getattr(keys, key) for key in said if getattr(keys, key) != getattr(default, key)}
    output: Output = _parse(Output, {key: value for key, value in table.items() if key in own}, ("output",))
    return replace(output, writers=found)


def to_dict(scene: Scene) -> dict[str, Any]:
    """The scene as plain data, every default filled in; `from_dict` reads it back."""
    hints = kinds_of_keys() | {"geometry": type(scene.geometry)}
    plain = {
        f.name: TypeAdapter(hints[f.name]).dump_python(
            getattr(scene, f.name), mode="json", by_alias=True, exclude_none=True
        )
        for f in fields(Scene)
        if f.name != "sections"
    }
    plain["output"] |= plain["output"].pop("writers")
    for effect in EFFECTS:
        if effect.name in scene.sections:
            adapter = TypeAdapter(effect.table)
            plain[effect.name] = adapter.dump_python(scene.sections[effect.name], mode="json", by_alias=True)
    return plain


def with_method(solver: Settings, words: str) -> Settings:
    """[solver] with another method, given as NAME or NAME+KEY=VALUE+KEY=VALUE with some of its keys.

    Raises:
        SceneError: an unknown key, or a value that it refuses.
    """
    name, *keys = words.split("+")
    adapter: TypeAdapter[Any] = TypeAdapter(Solver)
    table = adapter.dump_python(solver, mode="json", by_alias=True, exclude_none=True) | {"method": name}
    for key in keys:
        _override(table, key)
    found: Settings = _parse(Solver, table, ("solver",))
    return found


def _parse(kind: Any, value: Any, at: tuple[str, ...]) -> Any:
    try:
        return TypeAdapter(kind).validate_json(json.dumps(value, default=str), strict=True)
    except ValidationError as error:
        raise SceneError(_explain(error, kind, {at[0]: value}, at)) from None


def _explain(error: ValidationError, kind: Any, data: Mapping[str, Any], at: tuple[str, ...]) -> str:
    """The most specific of pydantic's errors, in one line in terms of the scene's keys."""
    rank = {"unexpected_keyword_argument": 0, "value_error": 1, "missing": 2}
    problem = min(error.errors(include_url=False), key=lambda e: (rank.get(e["type"], 3), len(e["loc"])))
    path, node = list(at), data[at[0]]
    for part in problem["loc"]:  # pydantic also names the branch of a choice; the file does not
        if (isinstance(node, Mapping) and part in node) or (
            isinstance(node, list) and isinstance(part, int) and part < len(node)
        ):
            path.append(str(part))
            node = node[part]  # type: ignore[index]
    key, found = ".".join(path), json.dumps(node, ensure_ascii=False, default=str)
    what, context = problem["type"], problem.get("ctx", {})
    if what == "value_error":
        return f"{key}.{context['error']}" if isinstance(node, Mapping) else f"{key}: {context['error']}"
    if what == "missing" and isinstance(node, list):  # a row of a value in time
        return f"{key} = {found}: expected a pair [time, value]"
    if what in ("missing", "missing_argument", "missing_keyword_only_argument"):
        return f"{key}.{problem['loc'][-1]}: missing, it has no default"
    if what == "unexpected_keyword_argument":
        return f"{key}: unknown key; {nearest(path[-1], _keys_at(kind, data[at[0]], path[1:-1]))}"
    if what == "union_tag_invalid":
        tag = context["discriminator"].strip("'")
        wanted = [name.strip(" '") for name in context["expected_tags"].split(",")]
        return f"{key}.{tag} = {json.dumps(context['tag'])}: not one of these; {nearest(str(context['tag']), wanted)}"
    if what == "union_tag_not_found":
        return f"{key}.{context['discriminator'].strip(chr(39))}: missing, it says which kind is meant"
    if what == "literal_error":
        wanted = [name.strip(" '") for name in context["expected"].replace(" or ", ",").split(",")]
        return f"{key} = {found}: not one of these; {nearest(str(node), wanted)}"
    if what == "float_type" and "float" in problem["loc"]:  # one branch of a value in time
        return f"{key} = {found}: expected a number, or a table [[time, value], ...]"
    return f"{key} = {found}: {EXPECTED.get(what, problem['msg'][0].lower() + problem['msg'][1:])}"


def _keys_at(kind: Any, data: Any, path: Sequence[str]) -> set[str]:
    """Valid names in the table at `path`, found by walking the types along the data."""
    kind = (
        next((k for k in get_args(kind) if k is not type(None)), kind)
        if get_origin(kind) in (Union, UnionType)
        else kind
    )
    if get_origin(kind) is Annotated:
        return _keys_at(get_args(kind)[0], data, path)
    if get_origin(kind) is Mapping:
        return _keys_at(get_args(kind)[1], data[path[0]], path[1:]) if path else set()
    if isinstance(kind, type) and issubclass(kind, Choice) and Choice in kind.__bases__:
        tags = {get_args(get_type_hints(k)[kind.tag])[0]: k for k in kind.kinds}
        kind = tags[data[kind.tag]] if len(tags) > 1 else kind.kinds[0]
    if not is_dataclass(kind):
        return set()
    hints = get_type_hints(kind, include_extras=True)
    names = {f.name.rstrip("_"): hints[f.name] for f in fields(kind)}
    return _keys_at(names[path[0]], data[path[0]], path[1:]) if path else set(names)


def _refuse_non_finite(value: Any, path: tuple[str, ...]) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise SceneError(f"{'.'.join(path)} = {value}: must be a finite number")
    items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        _refuse_non_finite(item, (*path, str(key)))


def _override(data: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise SceneError(f"--set {override}: expected KEY=VALUE, for example solver.method=uzawa")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text  # a bare word is a string
    *tables, last = key.strip().split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise SceneError(f"--set {override}: {table} is not a table")
    data[last] = value


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
