"""steps.jsonl: one line of JSON a step, as in result.json but for the audit, for programs that follow a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.keys import Key
from stickslip.solvers.results.step_result import Errors, StepResult, told
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.files import disk_errors, json_text, write_aside
from stickslip.workflows.writers.writer import Ended, Keys, Turn, Writer, keys_of

NAME = "steps.jsonl"


@dataclass(frozen=True, kw_only=True)
class JsonlKeys(Keys):
    """Whether the lines are written."""

    jsonl: Annotated[bool, Key("-", "write steps.jsonl: each step as a line of JSON, as soon as it is solved")] = False


class JsonLines(Writer):
    """A line a step; errors of its numbers follow at the end of the run."""

    turn = Turn.BEFORE
    keys = JsonlKeys
    reader, files = "scripts", (NAME,)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return keys_of(JsonlKeys, scene.output).jsonl

    def step(self, index: int, result: StepResult) -> None:
        path = self.job.folder / NAME
        with disk_errors(path), path.open("ab") as file:
            file.write(line(result))

    def resume(self, steps: Sequence[StepResult]) -> None:
        write_aside(self.job.folder / NAME, *map(line, steps))

    def finish(self, ended: Ended) -> None:
        """Write all lines anew, with the errors if they were estimated."""
        errors: Sequence[Errors | None] = ended.errors or [None] * len(ended.steps)
        write_aside(self.job.folder / NAME, *map(line, ended.steps, errors))


def line(step: StepResult, errors: Errors | None = None) -> bytes:
    """A step on one line."""
    return f"{json_text(told(step, errors), indent=None)}\n".encode()
