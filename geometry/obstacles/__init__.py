"""Rigid obstacles; a module that defines an `Obstacle` is found by itself."""

from __future__ import annotations

import importlib
import pkgutil

from stickslip.geometry.obstacles.obstacle import Obstacle

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["Obstacle"]
