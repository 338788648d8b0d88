"""`stickslip schema`: JSON schemas of what people and programs write and read."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.commands.process import speaks


def schema(
    of: Annotated[str, typer.Argument(metavar="[scene|result]", help="scene files, or result.json")] = "scene",
) -> None:
    """Print the JSON schema of scene files, by which editors complete and check them, or that of result.json."""
    from stickslip.workflows.run.result import result_schema
    from stickslip.workflows.scene_file.schema import scene_schema

    schemas = {"scene": scene_schema, "result": result_schema}
    if of not in schemas:
        raise SceneError(f"{of}: has no schema; {nearest(of, schemas)}")
    if speaks():
        typer.echo(json.dumps(schemas[of](), indent=1, ensure_ascii=False))
