"""Options of PETSc that a user gives for the solvers of one method, in force only while these are set up."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from petsc4py import PETSc

from stickslip.geometry.errors import SceneError
from stickslip.solvers.linear.petsc_library import option_used

EXAMPLE = "write for example -fieldsplit_u_ksp_type cg -fieldsplit_u_pc_type gamg"


class PetscOptions:
    """The options, with a prefix that the user leaves out; those that PETSc has used are known afterwards."""

    def __init__(self, text: str, prefix: str, solvers: tuple[str, ...] = ("",)) -> None:
        """Read and check the options; no collective call.

        Args:
            text: as on a command line.
            prefix: put before each name.
            solvers: prefixes, after `prefix`, of the solvers that will read them.

        Raises:
            SceneError: a word is no option, or PETSc refuses a value.

        >>> PetscOptions("-ksp_view -fieldsplit_u_ksp_rtol 1e-10", "block_").values
        {'block_ksp_view': None, 'block_fieldsplit_u_ksp_rtol': '1e-10'}
        """
        self.prefix, self.values = prefix, dict(_parsed(text, prefix))
        self._used: set[str] = set()
        self._named: set[str] = set()
        for solver in solvers if self.values else ():
            self._check(prefix + solver)
        self._used.clear()

    @contextmanager
    def in_force(self, defaults: Mapping[str, str] | None = None) -> Iterator[None]:
        """Give PETSc the options, and `defaults` (full names) where they say nothing; take them back at the end."""
        known, values = PETSc.Options(), {**(defaults or {}), **self.values}
        for name, value in values.items():
            known.setValue(name, value)
        try:
            yield
        finally:
            self._used.update(name for name in self.values if option_used(name))
            for name in values:
                known.delValue(name)

    def unused(self) -> list[str]:
        """Options that PETSc has not asked for up to now, as the user wrote them; each is named only once."""
        found = [name for name in self.values if name not in self._used | self._named]
        self._named.update(found)
        return [f"-{name.removeprefix(self.prefix)}" for name in found]

    def _check(self, prefix: str) -> None:
        one = PETSc.Mat().createAIJ(1, nnz=1, comm=PETSc.COMM_SELF)
        one.setUp()
        one.assemble()
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setOptionsPrefix(prefix)
        ksp.setOperators(one)
        try:
            with self.in_force():
                ksp.setFromOptions()
        except PETSc.Error as error:
            text = " ".join(
                f"-{name.removeprefix(self.prefix)} {value or ''}".strip() for name, value in self.values.items()
            )
            raise SceneError(f"petsc_options = {text}: PETSc refuses it with error {error.ierr}; {EXAMPLE}") from None


def _parsed(text: str, prefix: str) -> Iterator[tuple[str, str | None]]:
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise SceneError(f"petsc_options = {text}: {error}") from None
    while words:
        name = words.pop(0)
        if not _is_name(name):
            raise SceneError(f"petsc_options = {name}: is not an option; {EXAMPLE}")
        yield prefix + name[1:], words.pop(0) if words and not _is_name(words[0]) else None


def _is_name(word: str) -> bool:
    return word.startswith("-") and word[1:2].isalpha()
