"""fatigue_NAME.csv, stress_NAME.csv: fretting numbers of a contact over a cycle, and stresses they follow from.

fretting.csv: the largest of each, the node that has it, and its error.

They are made at the end, from the steps of the cycle and their files.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import nearest, require
from stickslip.geometry.keys import Key, Noun
from stickslip.solvers.accuracy.budget import Coarser
from stickslip.solvers.results.fretting import Below
from stickslip.solvers.results.step_result import StepResult, SurfaceMesh
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.record import STRESSES
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.csv_tables import Table, write_tables_again
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.writers.writer import Ended, Job, Keys, Turn, Writer, keys_of

KEY = "output.fretting"
LARGEST = "fretting.csv"


@dataclass(frozen=True, kw_only=True)
class FrettingCycle(Noun):
    """A cycle of a contact."""

    cycle: Annotated[tuple[float, float], Key("s", "its start and end, both among the times of the steps")]
    dang_van: Annotated[float | None, Key("-", "weight of the hydrostatic stress; absent: no such number")] = None

    def __post_init__(self) -> None:
        start, end = self.cycle
        require(0 < start < end, "cycle", list(self.cycle), "must be two times, the later one last, above 0")
        require(self.dang_van is None or self.dang_van >= 0, "dang_van", self.dang_van, "must not be negative")


@dataclass(frozen=True, kw_only=True)
class FrettingKeys(Keys):
    """Contacts of which they are written."""

    fretting: Annotated[
        Mapping[str, FrettingCycle],
        Key("-", "by contact: fretting numbers of a cycle at the nodes, in fatigue_NAME.csv"),
    ] = field(default_factory=dict)


class FrettingTables(Writer):
    """Two tables a contact; none where the run ends before the cycle does."""

    turn = Turn.AFTER
    keys = FrettingKeys
    reader, files = "programs for fatigue", ("fatigue_*.csv", "stress_*.csv", "fretting.csv")

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        """Whether the scene asks for them.

        Raises:
            SceneError: of a contact, body or time that has no such numbers.
        """
        asked, times = keys_of(FrettingKeys, scene.output).fretting, scene.requested_times()
        for name, given in asked.items():
            where, contact = f"{KEY}.{name}", scene.pairs.get(name)
            require(contact is not None, where, "given", f"no contact has this name; {nearest(name, scene.pairs)}")
            assert contact is not None
            require(contact.friction is not None, where, "given", "the contact has no friction")
            require(contact.aside is None, where, "given", "the contact slides out of the plane: it has no cycle")
            body = scene.slave_and_master(name)[0].split(".")[0]
            plain = isinstance(scene.bodies[body], Material)
            require(plain, where, "given", f"body {body}, which carries the tractions, is not isotropic")
            require(scene.steps.clock is None, where, "given", "steps.clock chooses the times of its own")
            for time in given.cycle:
                near = min(times, key=lambda t: abs(t - time))
                require(
                    time in times, f"{where}.cycle", list(given.cycle), f"no step ends at {time:g}; nearest {near:g}"
                )
            kept = all(scene.output.stores(k) for k in _steps_of(given, times) if k < len(times))
            require(kept, f"{where}.cycle", list(given.cycle), "output.step_files leaves out fields of its steps")
        return bool(asked)

    def __init__(self, job: Job) -> None:
        """
        Raises:
            SceneError: a body strains without stress.
        """
        super().__init__(job)
        assert job.simulation is not None
        self._asked, system = keys_of(FrettingKeys, job.scene.output).fretting, job.simulation.system
        self._below = dict[str, Below]()
        strained = {given.body for given in system.initial.strains}
        for rows in (rows for rows in system.contacts if rows.name in self._asked):
            body = job.scene.slave_and_master(rows.name)[0].split(".")[0]
            free = body not in strained
            require(free, f"{KEY}.{rows.name}", "given", f"body {body} expands or is a bolt: Hooke's law is not all")
            material, model = system.problem.isotropic[body], system.problem.model
            self._below[rows.name] = Below(job.mesh.surfaces[rows.name], rows.frames[:, 0], rows.sense, material, model)

    def names(self) -> Sequence[str]:
        return [*(f"{what}_{name}.csv" for name in self._asked for what in ("fatigue", "stress")), LARGEST]

    def resume(self, steps: Sequence[StepResult]) -> None:
        """The run makes them anew when it ends."""
        write_tables_again(self.job.folder, (), self.names())

    def finish(self, ended: Ended) -> None:
        times = [step.time for step in ended.steps]
        reached = [name for name, given in self._asked.items() if given.cycle[1] in times]
        write_tables_again(self.job.folder, self._all(reached, ended, times), self.names())

    def _all(self, reached: Sequence[str], ended: Ended, times: Sequence[float]) -> Iterator[Sequence[Table]]:
        largest = list[list[Any]]()
        for name in reached:
            tables, numbers = self._tables(name, ended.steps, times)
            largest += self._largest(name, numbers, ended.coarser, times)
            yield tables
        if reached:
            places = "xyz"[: self.job.mesh.points.shape[1]]
            yield [Table(LARGEST, ["contact", "number", *places, "largest", "error"], largest)]

    def _largest(
        self, name: str, numbers: Mapping[str, Array], coarser: Coarser | None, times: Sequence[float]
    ) -> list[list[Any]]:
        """Rows of the largest numbers of a contact, with their errors where a coarser mesh tells of them.

        At the edges of contact and stick all vary as the root of the distance, so that they err as the root of the
        cells' length; and no less than by what the highest neighbour lacks, for the largest value lies between nodes.
        """
        others, below = dict[str, Array](), self._below[name]
        if coarser is not None:
            rows = coarser.contacts[name]
            side = SurfaceMesh(points=rows.surface.points, facets=rows.surface.facets, shape=rows.surface.shape)
            contacts = [coarser.steps[k - 1].contacts[name] for k in _steps_of(self._asked[name], times)]
            on_it = replace(below, mesh=side, normals=rows.frames[:, 0])
            stress = np.array([on_it.stress(each, each.moved) for each in contacts if each.moved is not None])
            others = on_it.numbers(contacts, stress, self._asked[name].dang_van)
        found, facets = list[list[Any]](), below.mesh.facets
        for key, values in numbers.items():
            if key.startswith("swt_"):  # a direction
                continue
            at, off = int(values.argmax()), None
            if coarser is not None:
                near = np.setdiff1d(facets[(facets == at).any(axis=1)], at)
                apart = abs(values[at] - others[key].max()) / (np.sqrt(coarser.factor) - 1)
                off = float(max(apart, values[at] - values[near].max()))
            found.append([name, key, *below.mesh.points[at].tolist(), float(values[at]), off])
        return found

    def _tables(
        self, name: str, steps: Sequence[StepResult], times: Sequence[float]
    ) -> tuple[list[Table], dict[str, Array]]:
        """The tables of a contact, from the files of a cycle's steps, and its fretting numbers."""
        below, mesh = self._below[name], self.job.mesh
        dim, nodes, indices = mesh.points.shape[1], mesh.slaves[name], _steps_of(self._asked[name], times)
        moved = [read_step(self.job.folder / step_name(k)).displacement[nodes, :dim] for k in indices]
        contacts = [steps[k - 1].contacts[name] for k in indices]
        stress = np.array([below.stress(contact, u) for contact, u in zip(contacts, moved, strict=True)])
        places = dict(zip("xyz", below.mesh.points.T, strict=False))
        numbers = below.numbers(contacts, stress, self._asked[name].dang_van)
        columns = places | numbers
        fatigue = Table(f"fatigue_{name}.csv", list(columns), np.transpose([*columns.values()]).tolist())
        shown = [*STRESSES][: 4 if dim == 2 else 6]
        rows = [
            [times[k - 1], *place, *(float(at_node[STRESSES[part]]) for part in shown)]
            for k, at_time in zip(indices, stress, strict=True)
            for place, at_node in zip(below.mesh.points.tolist(), at_time, strict=True)
        ]
        return [fatigue, Table(f"stress_{name}.csv", ["time", *places, *shown], rows)], numbers


def _steps_of(given: FrettingCycle, times: Sequence[float]) -> list[int]:
    """Indices, from 1 on, of the steps at whose ends a cycle is known."""
    return [k for k, time in enumerate(times, start=1) if given.cycle[0] <= time <= given.cycle[1]]
