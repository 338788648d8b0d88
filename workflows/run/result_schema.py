"""The JSON schema of result.json."""

from typing import Any


def result_schema() -> dict[str, Any]:
    return {}
