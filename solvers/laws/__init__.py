"""Contact laws at a point; every module here that defines a `NormalLaw` or `FrictionLaw` is loaded."""

from __future__ import annotations

import importlib
import pkgutil

from stickslip.solvers.laws.law import FrictionLaw, NormalLaw

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["FrictionLaw", "NormalLaw"]
