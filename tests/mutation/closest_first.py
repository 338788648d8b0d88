"""A plugin of pytest: those tests run first that call the fewest functions, which they know best."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

SEEN = Path("mutmut-stats.json")  # what mutmut has seen, in the folder in which it runs tests


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """One file after the other, so that what its tests share is made once; of as many functions the shorter test."""
    if SEEN.exists():
        seen = json.loads(SEEN.read_text())
        calls = Counter(test for tests in seen["tests_by_mangled_function_name"].values() for test in tests)
        seconds = seen["duration_by_test"]
        fewest = {item.path: calls[item.nodeid] for item in sorted(items, key=lambda item: -calls[item.nodeid])}
        items.sort(key=lambda item: (fewest[item.path], item.path, calls[item.nodeid], seconds.get(item.nodeid, 0.0)))
