"""Registry of the solution methods: every module of methods/ and classical/ whose class has a NAME.

`METHODS` lists them by name, in the order of the table of methods in docs: by ROW, then by name. `Solver` is the
table [solver] with the keys of all methods. Methods access the bodies only through `SurfaceProblem`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import field, fields, make_dataclass
from typing import Any

from stickslip.geometry.errors import require_known
from stickslip.solvers import classical, methods
from stickslip.solvers.methods.method import Method, keys_of
from stickslip.solvers.scene import settings

_modules = [
    importlib.import_module(f"{room.__name__}.{found.name}")
    for room in (methods, classical)
    for found in pkgutil.iter_modules(room.__path__)
]
_found: set[type[Method]] = {
    kind
    for module in _modules
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Method) and "NAME" in vars(kind)
}

METHODS: Mapping[str, type[Method]] = {
    kind.NAME: kind for kind in sorted(_found, key=lambda kind: (kind.ROW, kind.NAME))
}


def method_of(solver: settings.Solver) -> Method:
    """The method that the settings name, with its keys.

    Raises:
        SceneError: no method has that name, or a value is out of range.
    """
    require_known("method", solver.method, METHODS)
    return METHODS[solver.method].of(solver)


def _keys() -> list[tuple[str, Any, Any]]:
    """Name, annotation and default of every method's keys; a key that several methods share is the same in all."""
    known: dict[str, tuple[Any, Any]] = {}
    for kind in METHODS.values():
        defaults = {f.name: f.default for f in fields(kind)}
        for key, hint in keys_of(kind).items():
            other = known.setdefault(key, (hint, defaults[key]))
            assert other == (hint, defaults[key]), f"{kind.NAME}: {key} means something else in another method"
    return [(key, hint, field(default=default)) for key, (hint, default) in known.items()]


def _check(solver: settings.Solver) -> None:
    """Check the keys of every method, also of those that are not chosen.

    Raises:
        SceneError: a value is out of range, or no method has the name.
    """
    settings.Solver.__post_init__(solver)
    method_of(solver)
    for kind in METHODS.values():
        kind.of(solver)


Solver = make_dataclass(
    "Solver",
    _keys(),
    bases=(settings.Solver,),
    namespace={"__module__": __name__, "__doc__": settings.Solver.__doc__, "__post_init__": _check},
    frozen=True,
    kw_only=True,
)
