"""Peers in the page of the price benchmark: prices in the same unit, and the errors of their forces."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

from stickslip.workflows.lab.benchmarks.peers.ours import OURS
from stickslip.workflows.lab.benchmarks.peers.programs import PROGRAMS

Run = dict[str, Any]
INTRODUCTION = """
Other programs on the same meshes, with the same material, motion and friction, one thread. Seconds of the processor for
assembly, preparation and both steps, ours too; price: in linear solves by the same clock. Errors: of the forces after
the shift, relative to those of our program to 1e-10 on this mesh, whose contact holds at the nodes. GetFEM is exact in
its own discretisation of contact; CalculiX has another hexahedron and a penalty. Not all set-ups are the best that
their users know.
"""
COLUMNS = {
    "n": "d", "name": "", "version": "", "dofs": "d", "price": ".3g", "seconds": ".3g", "iterations": "d",
    "memory [GB]": ".2f", "error of N": ".1e", "error of T": ".1e", "penetration [m]": ".1e",
}  # fmt: skip


def section(dim: int, runs: Sequence[Run]) -> str:
    """The table of one dimension; empty if nothing was measured."""
    chosen = [run for run in runs if run["dim"] == dim]
    if not chosen:
        return ""
    head = "".join(f"<th>{key}" for key in COLUMNS)
    lines = [_line(row(run, chosen)) for run in chosen]
    how = "".join(f"<li>{p.name}: {html.escape(p.how)}" for p in PROGRAMS if dim in p.dims)
    return (
        f"<h3>Peers on the same meshes</h3><p>{INTRODUCTION}</p><ul>{how}</ul><table><tr>{head}{''.join(lines)}</table>"
    )


def row(run: Run, runs: Sequence[Run]) -> Run:
    """One row: price and errors relative to our run on the same mesh, None without one."""
    found = {"n": run["n"], "name": run["name"], "status": run["status"]}
    if "steps" not in run:
        return found
    last = run["steps"][-1]
    found |= {
        "version": run["version"],
        "dofs": run["dofs"],
        "seconds": run["seconds"],
        "iterations": sum(step["iterations"] for step in run["steps"]),
        "memory [GB]": run["memory"],
        "penetration [m]": last["penetration"],
    }
    exact = next((r for r in runs if r["name"] == OURS and r["n"] == run["n"] and "steps" in r), None)
    if exact is None:
        return found
    found["price"] = run["seconds"] / exact["unit"]
    if run["name"] != OURS:
        for column, key in (("error of N", "normal_force"), ("error of T", "tangential_force")):
            found[column] = last[key] / exact["steps"][-1][key] - 1
    return found


def _line(known: Run) -> str:
    cells = "".join(f"<td>{format(known[key], form) if key in known else ''}" for key, form in COLUMNS.items())
    because = "" if "seconds" in known else f"<td>{html.escape(known['status'])}"
    return f"<tr>{cells}{because}"
