"""stickslip schema: JSON schemas of what people and programs write and read."""

from __future__ import annotations

import json

from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.run.result import result_schema
from stickslip.workflows.scene_file.schema import scene_schema

SCHEMAS = {"scene": scene_schema, "result": result_schema}


def schema(of: str) -> str:
    """The text of a schema.

    Raises:
        SceneError: there is none of this name.
    """
    if of not in SCHEMAS:
        raise SceneError(f"{of}: has no schema; {nearest(of, SCHEMAS)}")
    return json.dumps(SCHEMAS[of](), indent=1, ensure_ascii=False)
