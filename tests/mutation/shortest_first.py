"""A plugin of pytest: of a file the shortest tests run first, by the times that mutmut has measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

MEASURED = Path("mutmut-stats.json")  # in the folder in which mutmut runs tests


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """One file after the other, so that what its tests share is made once."""
    seconds = json.loads(MEASURED.read_text())["duration_by_test"] if MEASURED.exists() else {}
    items.sort(key=lambda item: (item.path, seconds.get(item.nodeid, 0.0)))
