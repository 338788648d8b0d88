"""Ready shapes; a module that defines a `Builder` is found by itself."""

from __future__ import annotations

import importlib
import pkgutil

from stickslip.geometry.builders.builder import Builder

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["Builder"]
