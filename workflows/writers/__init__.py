"""Outputs of a run, and the formats of its files: a module here that defines a `Writer` is all it takes to add one.

Writers: contact_tables, history_table, pictures, probe_table, steps_table, xdmf; bases that several of them share:
tables, series. Formats, also of the run's own files: aside, hdf5, serialised, shapes, steps.
"""

from __future__ import annotations

import importlib
import pkgutil

from workflows.writers.writer import Writer

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["Writer"]
