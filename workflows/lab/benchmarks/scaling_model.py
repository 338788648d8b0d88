"""Cost model of a scene on many ranks, phase by phase: fitted to runs on one rank, and assumed of a cluster.

A cost has three shares: by unknown, by contact point, and fixed. What a share is divided by is the model: the work
of the bodies by the ranks, that at the contact by the ranks whose part touches it, and what every rank does by nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, log2
from typing import Any

import numpy as np
from scipy.optimize import nnls

from stickslip.geometry.arrays import Array

MOST_FACES = 6  # of a part, with which it has neighbours
COARSER = ((78, 4.6), (92, 3.9), (170, 2.1), (217, 2.1), (554, 2.4), (697, 3.0))  # entries of a row, rows over the next
COARSEST = 100  # rows
THICK = 27  # unknowns by contact point, from which on the cost of bodies is taken: eight cells high
Run = Mapping[str, Any]  # what `scaling_run` has printed


@dataclass(frozen=True)
class Size:
    """A problem, and the ranks that share it."""

    unknowns: float
    points: float  # of contact
    ranks: int = 1

    @property
    def nodes(self) -> float:
        """Nodes of the mesh."""
        return self.unknowns / 3

    @property
    def touching(self) -> float:
        """Contact points of the rank that has most: as compact parts touch the surface, all of it if there are few.

        >>> Size(3e6, 1e4, 1).touching, Size(3e6, 1e4, 1000).touching
        (10000.0, 100.0)
        """
        side = (self.nodes / self.ranks) ** (2 / 3)
        return float(min(self.points, max(self.points / self.ranks, round(side, 6))))

    @property
    def faces(self) -> float:
        """Sides of a part with which it touches others."""
        return min(log2(self.ranks), MOST_FACES)

    @property
    def levels(self) -> tuple[tuple[float, float], ...]:
        """Rows, and entries of a row, on each level of BoomerAMG.

        As it prints them for 353 thousand unknowns; below, the last ratio goes on.
        """
        rows, found = self.unknowns, list[tuple[float, float]]()
        while rows > COARSEST:
            entries, ratio = COARSER[min(len(found), len(COARSER) - 1)]
            found.append((rows, min(float(entries), rows)))
            rows /= ratio
        return tuple(found)

    @property
    def neighbours(self) -> float:
        """Parts that a part touches, summed over the levels: on coarse ones a row reaches over many parts.

        >>> Size(1e6, 1e4, 2).neighbours == len(Size(1e6, 1e4, 2).levels)
        True
        """
        return sum(self._beside(*level) for level in self.levels)

    def _beside(self, rows: float, entries: float) -> float:
        active = min(self.ranks, rows / 3)
        width, side = (entries / 3) ** (1 / 3), (rows / 3 / active) ** (1 / 3)
        return min(active - 1.0, float(2 * ceil((width - 1) / 2 / side) + 1) ** 3 - 1)


@dataclass(frozen=True)
class Machine:
    """Assumptions on a cluster; its cores are as fast as the one of the measurements."""

    latency: float = 1.5e-6  # of a message [s]
    node_bandwidth: float = 10e9  # of the network, to and from a node [bytes/s]
    ranks_per_node: int = 32
    object_latency: float = 2e-5  # of a stage of a collective of Python objects [s]

    @property
    def bandwidth(self) -> float:
        """Share of a rank [bytes/s]."""
        return self.node_bandwidth / self.ranks_per_node


@dataclass(frozen=True)
class Phase:
    """Sharing of a phase, and the terms that are fitted: by unknown, by contact point, fixed."""

    unknowns: str = "shared"  # "shared", "rank 0", or "" for none
    points: str = ""  # "shared" by those that touch, "replicated", or "" for none
    fixed: bool = False

    def terms(self, size: Size) -> Array:
        """Factors of the three costs (3,)."""
        unknowns = {"shared": size.unknowns / size.ranks, "rank 0": size.unknowns, "": 0.0}[self.unknowns]
        points = {"shared": size.touching, "replicated": size.points, "": 0.0}[self.points]
        return np.array([unknowns, points, float(self.fixed)])


ONCE = {
    "mesh": Phase("rank 0", fixed=True),
    "assemble": Phase("shared"),
    "surface": Phase("", "replicated"),
    "prepare": Phase("shared"),
    "coordinates": Phase("", "replicated"),
}
EACH = {  # iteration
    "product": Phase("shared"),
    "cycle": Phase("shared"),
    "columns": Phase("shared", "shared"),
    "contact": Phase("", "shared", fixed=True),
    "vectors": Phase("shared", "shared", fixed=True),
}
STEP = {"step": Phase("shared", "replicated")}
PHASES = ONCE | EACH | STEP
Costs = Mapping[str, Array]  # (3,) of each phase [s]: by unknown, by contact point, fixed


def size_of(run: Run) -> Size:
    """The size of a measured run."""
    return Size(run["unknowns"], run["points"], run["ranks"])


def seconds_of(run: Run) -> dict[str, float]:
    """Seconds of a measured run: those of phases, of one iteration by parts, and of a step without its iterations."""
    parts, count = run["parts"], sum(run["iterations"])
    each = {part: parts[part] / count for part in EACH if part != "vectors"}
    each["vectors"] = max(parts["iterations"] / count - sum(each.values()), 0.0)
    step = (run["seconds"]["iterate"] - parts["iterations"]) / len(run["iterations"])
    return {phase: run["seconds"][phase] for phase in ONCE} | each | {"step": max(step, 0.0)}


def fit(runs: Sequence[Run]) -> Costs:
    """Costs by which relative errors of runs on one rank are least; none is negative.

    Those of bodies alone are from runs that are no thin slabs.
    """
    found: dict[str, Array] = {}
    for name, phase in PHASES.items():
        used = [run for run in runs if phase.points or run["unknowns"] >= THICK * run["points"]]
        terms = np.array([phase.terms(size_of(run)) for run in used])
        found[name] = fitted(terms, np.array([seconds_of(run)[name] for run in used]))
    return found


def fitted(terms: Array, values: Array) -> Array:
    """Costs (k,) >= 0 of terms (n, k) for values (n,), by relative errors."""
    scale = np.where(terms.max(axis=0) > 0, terms.max(axis=0), 1.0)
    weight = 1 / np.maximum(values, 1e-12)
    found: Array = nnls(terms / scale * weight[:, None], values * weight)[0] / scale
    return found


@dataclass(frozen=True)
class Traffic:
    """Messages of an iteration, counted on few ranks."""

    messages: float  # to each neighbour on each level
    halo: float  # bytes by face and (unknowns of a rank)^(2/3)
    gathered: float  # bytes that each rank receives in a step, by contact point
    collectives: float  # of libraries
    objects: float  # collectives of Python objects

    @staticmethod
    def of(runs: Sequence[Run]) -> Traffic:
        """Means over runs on several ranks."""
        return Traffic(*(float(np.mean(values)) for values in zip(*map(_traffic, runs), strict=True)))

    def seconds(self, size: Size, machine: Machine) -> dict[str, float]:
        """Seconds of an iteration that waits for none: of messages, and of collectives."""
        if size.ranks == 1:
            return {"messages": 0.0, "collectives": 0.0}
        each = self.collectives * machine.latency + self.objects * machine.object_latency
        return {
            "messages": self.messages * size.neighbours * machine.latency + self.bytes(size) / machine.bandwidth,
            "collectives": log2(size.ranks) * each,
        }

    def gather(self, size: Size, machine: Machine) -> float:
        """Seconds of a step in which tractions and relative displacements of all points reach every rank."""
        return self.gathered * size.points / machine.bandwidth if size.ranks > 1 else 0.0

    def bytes(self, size: Size) -> float:
        """Bytes that a rank sends in an iteration to its neighbours."""
        return float(self.halo * size.faces * (size.unknowns / size.ranks) ** (2 / 3))


def _traffic(run: Run) -> tuple[float, ...]:
    """The fields of `Traffic` of a run, those of the rank that sends most."""
    size, count, sent, scatters = size_of(run), sum(run["iterations"]), run["sent"], run["events"]["VecScatterBegin"]
    objects = float(sum(run["calls"].values()))
    return (
        (sent["messages"][1] + scatters["messages"][1]) / count / size.neighbours,
        (sent["bytes"][1] + scatters["bytes"][1]) / count / size.faces / (size.unknowns / size.ranks) ** (2 / 3),
        sent["collective_bytes"][0] / len(run["iterations"]) / size.points,
        sent["collectives"][1] / count,
        objects / count,
    )


@dataclass(frozen=True)
class Memory:
    """Bytes of a rank."""

    base: float  # of Python and libraries
    unknown: float  # of the rank's share
    point: float  # of contact, on every rank
    own: float  # by contact point of the rank that touches most
    meshed: float  # by unknown, on rank 0 while gmsh runs
    objects: float  # of `point`, what Python holds when the steps are solved

    @staticmethod
    def of(single: Sequence[Run], several: Sequence[Run], drawn: Sequence[Run]) -> Memory:
        """From the peaks of runs on one rank and on several, and of gmsh alone; `objects` from what Python holds."""
        runs = (*single, *several)
        sizes = [size_of(run) for run in runs]
        terms = np.array([[s.unknowns / s.ranks, s.points, s.touching, 1.0] for s in sizes])
        unknown, point, own, base = fitted(terms, np.array([run["memory"][-1]["iterate"] for run in runs]))
        objects = fitted(terms, np.array([float(max(run["objects"])) for run in runs]))[1]
        gmsh = fitted(
            np.array([[run["unknowns"], 1.0] for run in drawn]), np.array([run["memory"][0]["gmsh"] for run in drawn])
        )
        return Memory(base, unknown, point, own, gmsh[0], objects)

    def of_rank(self, size: Size) -> dict[str, float]:
        """Bytes of each rank by what they are for; `mesh` is on rank 0 alone."""
        return {
            "programs": self.base,
            "bodies": self.unknown * size.unknowns / size.ranks,
            "contact": self.point * size.points,
            "own": self.own * size.touching,
            "mesh": self.meshed * size.unknowns,
        }


@dataclass(frozen=True)
class Prediction:
    """Seconds of a run by phase."""

    once: Mapping[str, float]  # mesh, assembly, preparation
    step: float  # of one step, beside its iterations
    iteration: Mapping[str, float]  # of one iteration, by parts

    def total(self, steps: int, iterations: int, slower: Mapping[str, float] | None = None) -> float:
        """Seconds of a run with so many steps, and iterations in all of them; some phases slower by a factor."""
        by = dict.fromkeys((*self.once, "step", "iteration"), 1.0) | dict(slower or {})
        once = sum(by[name] * seconds for name, seconds in self.once.items())
        return once + by["step"] * steps * self.step + by["iteration"] * iterations * sum(self.iteration.values())


def predicted(costs: Costs, traffic: Traffic | None, size: Size, machine: Machine) -> Prediction:
    """Seconds of a run of that size.

    Args:
        costs: from runs on one rank.
        traffic: from runs on several; None: messages cost nothing.
        size: of the run.
        machine: that it runs on.
    """

    def cost(name: str) -> float:
        return float(costs[name] @ PHASES[name].terms(size))

    each, gather = {name: cost(name) for name in EACH}, 0.0
    if traffic is not None:
        each |= traffic.seconds(size, machine)
        gather = traffic.gather(size, machine)
    return Prediction({name: cost(name) for name in ONCE}, cost("step") + gather, each)
