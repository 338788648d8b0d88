"""Outputs of a run, and the formats of its files: a module here that defines a `Writer` is all it takes to add one.

writer is the contract; tables and series are bases that several writers share; paraview_view is a program for ParaView
that vtu copies; every other module is a writer.
"""

from __future__ import annotations

import importlib
import pkgutil

from stickslip.workflows.writers.writer import Writer

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["Writer"]
