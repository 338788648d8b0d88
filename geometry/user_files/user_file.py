"""A geometry from a user's file: .geo, .step, .brep, .py, or a mesh, by its ending."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field
from pydantic.json_schema import SkipJsonSchema

from stickslip.geometry.arrays import ROUNDING, Array, Ints
from stickslip.geometry.curved_facets import Bulging
from stickslip.geometry.errors import GeometryError, SceneError, nearest, prefixed, require
from stickslip.geometry.keys import Key, Noun
from stickslip.geometry.mesh_sizes import filled, refined_near
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import SKIN, Model, Request, Shape
from stickslip.geometry.units import LENGTHS, Units
from stickslip.geometry.user_files.interpenetration import Overlap, overlaps
from stickslip.geometry.user_files.meshing import MeshOptions, cut_to_sizes
from stickslip.geometry.user_files.open_file import KINDS, Parameter, declared_unit, kind_of, parameter_names
from stickslip.geometry.user_files.outline import Outline
from stickslip.geometry.user_files.raw_mesh import RawMesh
from stickslip.geometry.user_files.reader import Question, ask
from stickslip.geometry.user_files.touching import Pair, close_pairs, meeting, thinned

DEBIAN = Path("/usr/share/doc/gmsh-doc/doc/gmsh")  # gmsh's own files, of which ready scenes use some
WHEEL = Path(sys.prefix, "share/doc/gmsh")  # the same ones, not compressed, in gmsh from PyPI
EXAMPLES = ("demos", "examples")  # their folder, older and newer
CELLS, AROUND = 20_000, 8  # of a CAD file without mesh_size: in its volume, and on a full circle
WITH_PARAMETERS = ("geo", "py")  # kinds of file


def installed(path: Path) -> Path:
    """The path itself, or of a file of Debian's gmsh-doc, where another version or PyPI's gmsh has it."""
    if DEBIAN not in path.parents or path.exists():
        return path
    parts = path.relative_to(DEBIAN).parts[1:]
    others = (Path(place, folder, *parts) for place in (DEBIAN, WHEEL) for folder in EXAMPLES)
    return next((found for other in others for found in (other, other.with_suffix("")) if found.is_file()), path)


@dataclass(frozen=True, kw_only=True)
class Box(Noun):
    """Selects the entities that lie wholly inside a box."""

    box: Annotated[tuple[float, ...], Key("m", "lower, then upper corner")]

    def __post_init__(self) -> None:
        require(len(self.box) == 6, "box", list(self.box), "expected [x0, y0, z0, x1, y1, z1]")
        ordered = all(a <= b for a, b in zip(self.box[:3], self.box[3:], strict=True))
        require(ordered, "box", list(self.box), "empty; each lower coordinate must not exceed the upper one")


@dataclass(frozen=True, kw_only=True)
class UserFile(Noun, Shape):
    """A user's file; all other keys are parameters of a .geo or .py file."""

    file: Annotated[
        str,
        Key(
            "-",
            ".geo, .step, .brep, .msh or .py, or a mesh of another program, .inp, .unv, .med, .vtu, .vtk or .bdf "
            "(or any of these .gz), relative to the scene file",
        ),
    ]
    length_unit: Annotated[
        Literal["m", "dm", "cm", "mm", "um", "nm", "km", "in", "ft"] | None,
        Key(
            "-",
            "unit of the file's coordinates, which become those of the scene's `units`; absent: the same; write \"mm\" "
            "for every STEP file: gmsh turns its own unit into mm",
        ),
    ] = None
    mesh_size: Annotated[
        float | None,
        Key(
            "m",
            "edge length of the cells; absent: the file's own, of CAD files for 20 000 cells, and more on curved faces",
        ),
    ] = None
    contact_mesh_size: Annotated[
        float | None,
        Key("m", "edge length at contact surfaces, between bodies where they are close; absent: mesh_size"),
    ] = None
    cells: Annotated[Literal["simplex"], Key("-", "triangles and tetrahedra; a .geo may recombine them itself")] = (
        "simplex"
    )
    order: Annotated[Literal[1, 2], Key("-", "polynomial degree of displacement and geometry")] = 1
    time_limit: Annotated[
        float | None, Key("s", "for gmsh to read the file, and again to mesh it; absent: 50 s and an hour")
    ] = None
    names: Annotated[
        Mapping[str, tuple[str, ...] | Box],
        Key(
            "-",
            'sides to name: "part.base" = ["face 12"] (2D: "edge 3"), or { box = [x0, y0, z0, x1, y1, z1] } in m; '
            'bodies to rename: clamp = ["part_2"], or to make one: clamp = ["part", "part_2"]',
        ),
    ] = field(default_factory=dict)
    parameters: Annotated[
        Mapping[str, Parameter], Key("-", "what .geo (numbers) or build(model, parameters) of .py is given")
    ] = field(default_factory=dict)
    scene_length: Annotated[str, Field(exclude=True), SkipJsonSchema()] = "m"  # no key: the scene sets its own unit

    def __post_init__(self) -> None:
        path = Path(self.file)
        kind = kind_of(path)
        require(kind is not None, "file", self.file, f"unknown ending; expected one of {', '.join(KINDS)}")
        hint = "; it is in Debian's package gmsh-doc: apt-get install gmsh-doc" if DEBIAN in path.parents else ""
        require(path.is_file(), "file", self.file, f"no such file{hint}")
        for key in ("mesh_size", "contact_mesh_size"):
            value = getattr(self, key)
            require(value is None or value > 0, key, value, "must be positive, in metres")
            require(value is None or kind != "msh", key, value, "a mesh file has its own mesh; remove the key")
        limit = self.time_limit
        require(limit is None or limit > 0, "time_limit", limit, "must be positive, in seconds")
        fine = self.contact_mesh_size
        size = self.mesh_size if kind != "cad" else self.mesh_size or np.inf
        require(fine is None or size is not None, "contact_mesh_size", fine, "needs mesh_size too")
        require(fine is None or fine <= (size or 0), "contact_mesh_size", fine, "must not exceed mesh_size")
        self._check_parameters(kind or "")

    def _check_parameters(self, kind: str) -> None:
        """Raise SceneError if a file of this kind cannot take the parameters."""
        if kind not in WITH_PARAMETERS:
            for name, value in self.parameters.items():
                require(False, name, value, "only .geo and .py files take parameters")
        if kind == "geo":
            known = parameter_names(Path(self.file)) if self.parameters else {}
            for name, value in self.parameters.items():
                number = isinstance(value, int | float) and not isinstance(value, bool)
                require(number, name, value, "a .geo file takes numbers only")
                unknown = f"{Path(self.file).name} has no such DefineConstant; {nearest(name, known)}"
                require(name in known, name, value, unknown)
                alike = [other for other in self.parameters if known.get(other) == known[name]]
                require(len(alike) == 1, name, value, f"{' and '.join(alike)} are one parameter; remove one")

    @property
    def degree(self) -> int:
        return self.order

    @property
    def unit(self) -> float:
        """Length unit of the file, in that of the scene."""
        if self.length_unit is None:
            return 1.0
        return float(Fraction(LENGTHS[self.length_unit]) / Fraction(LENGTHS[self.scene_length]))

    @property
    def _metres(self) -> float:
        """Length unit of the scene [m], if it is known: files are read in metres, so that units change no mesh."""
        return float(Fraction(LENGTHS.get(self.scene_length, "1")))

    @property
    def _file_metres(self) -> float:
        """Length unit of the file [m], or in that of the scene if this is not known."""
        return float(Fraction(LENGTHS[self.length_unit])) if self.length_unit else self._metres

    def measured_in(self, units: Units) -> Self:
        if self.length_unit is not None:
            with prefixed("geometry"):
                units.metres(f'length_unit = "{self.length_unit}"')
        return self if units.length == self.scene_length else replace(self, scene_length=units.length)

    def digest(self) -> str:
        """SHA-256 of the file's content when it is first asked for; later edits are ignored."""
        return self._digest

    @cached_property
    def _digest(self) -> str:
        return _digest_of(self.file)

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return self.outline(dim).bodies

    def check_model(self, model: Model) -> None:
        if model == "axisymmetric":
            left, size = self.box(2)[0, 0], np.ptp(self.box(2), axis=0).max()
            require(left >= -ROUNDING * size, "file", self.file, f"reaches x = {left:g}; x is the radius")

    def cell_count(self, request: Request) -> float:
        dim, size = request.dim, self.size(request.dim)
        if size is None:
            return 0.0
        outline, near = self.outline(dim), 0.0
        fine = self.contact_mesh_size
        if fine is not None and fine < size:
            depth, whole = float(np.ptp(outline.box, axis=0).max()), self._whole(request)
            areas = [f.size for f in outline.entities if outline.side_of.get(f.number) in whole]
            close = _close(self._key(dim), request.facing, fine * self._metres)
            areas += [area for p in close for area in 2 * (p.area / self._metres ** (dim - 1),)]
            near = sum(refined_near(area, depth, fine, size, dim) for area in areas)
        return filled(outline.volume, size, dim) + near

    def refuse_too_large(self, request: Request, free: float = np.inf) -> None:
        try:
            super().refuse_too_large(request, free)
        except SceneError as error:
            if not self.other_unit:
                raise
            hint = f"{self.as_read(request.dim)}; is length_unit = '{self.other_unit}' missing?"
            raise SceneError(f"{error}; {hint}") from None

    @property
    def other_unit(self) -> str | None:
        """Unit in which gmsh gives the file's coordinates, where they are taken to be in another one; else None."""
        declared, taken = declared_unit(Path(self.file)), self.length_unit or self.scene_length
        return None if declared == taken else declared

    def as_read(self, dim: int) -> str:
        """Size of the file in words."""
        box = " x ".join(f"{length:.3g}" for length in np.ptp(self.box(dim), axis=0))
        return f"the file's box, read in {self.length_unit or self.scene_length}, is {box} {self.scene_length}"

    def size(self, dim: int) -> float | None:
        """Edge length of the cells [m]; where a CAD file comes without one, that of CELLS cells of its volume."""
        if self.mesh_size is not None or kind_of(Path(self.file)) != "cad":
            return self.mesh_size
        size: float = filled(self.outline(dim).volume / CELLS, 1.0, dim) ** (1 / dim)
        return max(size, self.contact_mesh_size or 0.0)

    def _whole(self, request: Request) -> tuple[str, ...]:
        """The contact sides to refine everywhere; of the others only what is close to another one."""
        return tuple(side for side in request.contact_sides if not any(side in pair for pair in request.facing))

    def box(self, dim: int) -> Array:
        return self.outline(dim).box[:, :dim]

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        body, name = side.split(".")
        points, normals = self.skin(body, dim) if name == SKIN else self.outline(dim).samples[side]
        return points[:, :dim], normals[:, :dim]

    def meeting(self, one: str, other: str, reach: float, dim: int) -> tuple[Array, Array]:
        points, normals = meeting(self.outline(dim), one, other, reach)
        return points[:, :dim], normals[:, :dim]

    def skin(self, body: str, dim: int) -> tuple[Array, Array]:
        return self.outline(dim).skin(body)

    def boxes(self, body: str, dim: int) -> Array:
        return np.array([face.box[:, :dim] for face in self.outline(dim).entities if face.bodies == (body,)])

    def shared(self, dim: int) -> Mapping[tuple[str, str], Array]:
        return {bodies: points[:, :dim] for bodies, points in self.outline(dim).shared.items()}

    def note(self, dim: int) -> str:
        return self.outline(dim).note

    def overlaps(self, dim: int) -> Sequence[Overlap]:
        """Bodies that lie in each other, the deepest ones first."""
        return _overlaps(self._metres, self._key(dim))

    def outline(self, dim: int) -> Outline:
        """Names, box and sample points of the file, without a volume mesh; read once."""
        return _outline_in(self._metres, self._key(dim))

    def refined(self, factor: float) -> Self:
        size, fine = self.mesh_size, self.contact_mesh_size
        own = "a mesh file has its own mesh" if self.own_mesh else "missing; name one, in metres"
        if size is None:
            raise SceneError(f"mesh_size: there is none to refine, {own}")
        return replace(self, mesh_size=factor * size, contact_mesh_size=None if fine is None else factor * fine)

    @property
    def own_mesh(self) -> bool:
        """Whether the file is a mesh; its cells can be cut, and that is all."""
        return kind_of(Path(self.file)) == "msh"

    def refuse_sizes(self, request: Request) -> None:
        if self.own_mesh and request.periodic:
            raise SceneError("periodic: a mesh file has its own mesh, and cells that are cut would match no more")

    def put(self, gmsh: Gmsh, request: Request) -> float:
        unit = self.unit
        sizes = request.sizes and request.sizes.in_units_of(unit)
        size, fine, points = self.size(request.dim), self.contact_mesh_size, np.zeros((0, 3))
        if fine is not None and sizes is None:
            near = fine * self._metres
            apart = 2 * near  # cells between have grown little
            points = thinned(_close(self._key(request.dim), request.facing, near, apart), apart)
        options = MeshOptions(
            size=None if size is None else size / unit,
            fine_size=None if fine is None else fine / unit,
            fine_sides=self._whole(request),
            fine_points=points / self._file_metres,
            around=AROUND if self.mesh_size is None and size is not None and sizes is None else 0,
            periodic=request.periodic,
            turns={
                side: replace(turn, point=tuple(x / self._file_metres for x in turn.point))
                for side, turn in request.turns.items()
            },
            order=1 if self.own_mesh and sizes else self.order,
            sizes=None if self.own_mesh else sizes,
            with_skins=any(side.endswith(SKIN) for side in request.contact_sides),
        )
        mesh = ask(self.question(request.dim, options))
        assert isinstance(mesh, RawMesh)
        name = Path(self.file).name
        if _digest_of(self.file) != self.digest():
            raise GeometryError(f"{name}: has changed since the scene was read; read the scene again")
        if self.own_mesh and sizes is not None:
            mesh = cut_to_sizes(mesh, sizes)
        mesh.put(gmsh)
        self._placed["mesh"] = mesh
        return unit

    def bulging(self, gmsh: Gmsh, dim: int, unit: float) -> Bulging:
        known = self._placed["mesh"].bulging  # gmsh's model has the mesh alone, without the surfaces
        return super().bulging(gmsh, dim, unit) if known is None else known.times(unit)

    def edges(self, gmsh: Gmsh, sides: Mapping[str, Sequence[int]], dim: int) -> Mapping[str, Ints]:
        known = self._placed.pop("mesh").edges
        return {side: known[side] for side in sides if side in known}

    @cached_property
    def _placed(self) -> dict[str, RawMesh]:
        return {}

    def question(self, dim: int, mesh: MeshOptions | None = None) -> Question:
        """Pose the question to the child process: for the mesh if `mesh` is given, else for the outline."""
        metres = self._metres
        names = {k: {"box": [x * metres for x in v.box]} if isinstance(v, Box) else v for k, v in self.names.items()}
        path = Path(self.file).resolve()
        return Question(
            path=path,
            dim=dim,
            unit=self._file_metres,
            names=names,
            parameters=self.parameters,
            mesh=mesh,
            time_limit=self.time_limit,
        )

    def _key(self, dim: int) -> _Key:
        return _Key(self.question(dim), repr((self, dim, self.digest())))


def _digest_of(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError as error:
        raise GeometryError(f"{Path(file).name}: cannot be read: {error.strerror or error}") from None


@dataclass(frozen=True)
class _Key:
    """A question that is compared by all that its answer depends on, so that it can be the key of a cache."""

    question: Question = field(compare=False)
    text: str


@lru_cache(maxsize=8)
def _outline(key: _Key) -> Outline:
    found = ask(key.question)
    assert isinstance(found, Outline)
    return found


@lru_cache(maxsize=8)
def _outline_in(metres: float, key: _Key) -> Outline:
    """The outline in a unit of this length."""
    return _outline(key).times(1 / metres, key.question.dim)


@lru_cache(maxsize=8)
def _overlaps(metres: float, key: _Key) -> Sequence[Overlap]:
    return overlaps(_outline_in(metres, key), key.question.dim)


@lru_cache(maxsize=8)
def _close(key: _Key, facing: tuple[tuple[str, str], ...], fine: float, spacing: float = np.inf) -> Sequence[Pair]:
    return close_pairs(_outline(key), key.question.dim, facing, fine, spacing)
