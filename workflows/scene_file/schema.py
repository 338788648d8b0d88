"""The JSON schema of a scene file, from the same dataclasses as workflows/SCENE.md, for editors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from pydantic import TypeAdapter

from stickslip.geometry.builders import Builder
from stickslip.geometry.keys import adapter
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import REQUIRED, kinds_of_keys
from stickslip.workflows.writers.writer import added_keys

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scene_schema() -> dict[str, Any]:
    """The schema; what depends on several keys, such as the names of sides, is checked by `read` only."""
    kinds = {field.name: kinds_of_keys()[field.name] for field in fields(Scene) if field.name != "sections"}
    kinds |= {effect.name: effect.table for effect in EFFECTS if effect.table is not None}
    kinds |= {"geometry": Builder, "a file": UserFile}
    writers = {kind.__name__: kind for kind in added_keys().values()}
    found, shared = TypeAdapter.json_schemas(
        [(key, "validation", adapter(kind)) for key, kind in {**kinds, **writers}.items()]
    )
    tables: dict[str, Any] = {key: found[key, "validation"] for key in {**kinds, **writers}}
    definitions = shared["$defs"]

    def definition(schema: Any) -> Any:
        return definitions[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema

    output, file = definition(tables["output"]), definition(tables["a file"])
    del output["properties"]["writers"]
    for name in writers:
        output["properties"] |= definition(tables.pop(name))["properties"]
    file["additionalProperties"] = file["properties"]["parameters"]["additionalProperties"]
    file["not"] = {"required": ["builder"]}
    tables["geometry"] = {"anyOf": [tables["geometry"], tables.pop("a file")]}
    for family in _families([tables, definitions]):
        for kind in family["oneOf"]:
            required, tag = definition(kind).setdefault("required", []), family["discriminator"]["propertyName"]
            required += [tag] * (tag not in required)  # several tables share a kind
    definition(tables["solver"])["properties"]["method"]["enum"] = list(METHODS)
    scene = {
        "type": "object",
        "properties": tables,
        "required": list(REQUIRED),
        "additionalProperties": False,
        "$defs": definitions,
    }
    return {"$schema": DIALECT, "title": "Scene of stickslip", **_tidied(scene)}


def _families(node: Any) -> Iterator[dict[str, Any]]:
    """Every choice of a kind by a literal key."""
    if isinstance(node, dict) and "discriminator" in node:
        yield node
    for item in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _families(item)


def _tidied(node: Any, names: bool = False) -> Any:
    """Without the absence that TOML cannot write, and without titles that repeat the keys.

    Args:
        names: whether the keys of the node are those of a scene.
    """
    if isinstance(node, list):
        return [_tidied(item) for item in node if item != {"type": "null"}]
    if not isinstance(node, dict):
        return node
    left_out = () if names else ("discriminator", "title")
    kept = {
        key: _tidied(value, names=key in ("properties", "$defs") and not names)
        for key, value in node.items()
        if key not in left_out and value is not None
    }
    (one, *others) = kept.pop("anyOf", [{}])
    return kept | {"anyOf": [one, *others]} if others else one | kept
