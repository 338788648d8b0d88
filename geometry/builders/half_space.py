"""A large block with contact on a small part of its flat top."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.builders.builder import (
    SYMMETRIC,
    Builder,
    Places,
    Sides,
    box_corners,
    directions,
    flat_side,
    of_box,
)
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh_sizes import SIMPLICES, beyond, cells_around, grow, norm
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request


@dataclass(frozen=True, kw_only=True)
class HalfSpace(Builder):
    """A large block below y = 0 (in 3D z = 0); the side `contact` is |x| <= contact_half_width, in 3D a disc."""

    body: ClassVar[str] = "half_space"
    gridded: ClassVar[bool] = False
    lengths: ClassVar[tuple[str, ...]] = ("size", "contact_half_width", "edge_mesh_size")

    size: Annotated[float, Key("m", "depth and half width, about 40 contact half widths")]
    contact_half_width: Annotated[float, Key("m", "half width of side `contact`; its radius in 3D and axisymmetric")]
    edge_mesh_size: Annotated[
        float | None, Key("m", "edge length at the edges of the contact part; absent: contact_mesh_size")
    ] = None
    symmetric: Annotated[bool, Key("-", SYMMETRIC)] = False
    builder: Annotated[Literal["half_space"], Key("-", "the shape's name")] = "half_space"

    def __post_init__(self) -> None:
        super().__post_init__()
        width, edge = self.contact_half_width, self.edge_mesh_size
        require(width < self.size, "contact_half_width", width, "must be smaller than size")
        require(edge is None or edge <= self.fine_size, "edge_mesh_size", edge, "must not exceed contact_mesh_size")

    @property
    def edge_size(self) -> float:
        """Edge length at the edges of the contact part [m]."""
        return self.fine_size if self.edge_mesh_size is None else self.edge_mesh_size

    def check_model(self, model: Model) -> None:
        self.check_symmetric(self.symmetric, model)
        super().check_model(model)

    def cell_count(self, request: Request) -> float:
        dim, a = request.dim, self.contact_half_width
        within = cells_around(dim, self.fine_size, a, self.mesh_size, self.size)
        edge = cells_around(2, self.edge_size, 0.0, self.fine_size, a) * (1 if dim == 2 else a / self.edge_size)
        return SIMPLICES[dim] * (within + edge) * (0.5 if self.symmetric else 1.0)

    def box(self, dim: int) -> Array:
        low, high = np.full(dim, -self.size), np.full(dim, self.size)
        high[-1] = 0.0
        if self.symmetric:
            low[0] = 0.0
        return np.array([low, high])

    def sides(self, dim: int) -> Sides:
        a, box = self.contact_half_width, self.box(dim)
        flat = {name: box_corners(box, *place) for name, place in self._places(dim).items()}
        if dim == 3:
            edge = a * np.pad(directions(np.arange(0.0, 360.0, 45.0)), ((0, 0), (0, 1)))
        else:
            edge = np.array([[a, 0.0]] if self.symmetric else [[-a, 0.0], [a, 0.0]])
        outside = flat["top"][0][flat["top"][0][:, 0] > 0] if self.symmetric else flat["top"][0]
        contact, top = (np.concatenate([edge, others]) for others in (np.zeros((1, dim)), outside))
        return {"contact": flat_side(contact, dim - 1, 1), **flat, "top": flat_side(top, dim - 1, 1)}

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """The contact part is cut out of the top; in 2D the origin is a vertex too."""
        occ, dim, a = gmsh.model.occ, request.dim, self.contact_half_width
        low, high = self.box(dim)
        if dim == 3:
            block = occ.addBox(*low, *(high - low))
            occ.fragment([(3, block)], [(2, occ.addDisk(0, 0, 0, a, a))])
        else:
            block = occ.addRectangle(*low, 0, *(high - low))
            cuts = [0.0, a] if self.symmetric else [-a, 0.0, a]
            ends = [occ.addPoint(x, 0, 0) for x in cuts]
            occ.fragment([(2, block)], [(1, occ.addLine(*pair)) for pair in pairwise(ends)])
        occ.synchronize()
        tags = self.outer(gmsh, dim, self._places(dim))
        reach = a * (1 + 1e-3) + CLOSE  # gmsh enlarges bounding boxes by 1e-7
        boxes = {tag: gmsh.model.getBoundingBox(dim - 1, tag) for tag in tags["top"]}
        contact = [tag for tag, box in boxes.items() if -reach < box[0] and box[3] < reach]
        found = {"contact": contact} | tags | {"top": [tag for tag in tags["top"] if tag not in contact]}
        self.name_groups(gmsh, dim, found)
        across = "Abs(x)" if dim == 2 else norm("x", "y")
        depth = "xyz"[dim - 1]
        near = [(self.fine_size, norm(beyond(a, across), depth)), (self.edge_size, norm(f"{across}-{a:.17g}", depth))]
        grow(gmsh, self.mesh_size, near)
        self.match_periodic(gmsh, request, self._places(dim), found)

    def _places(self, dim: int) -> Places:
        """Flat sides; `top` contains the contact part."""
        return {"axis" if self.symmetric and name == "left" else name: at for name, at in of_box(dim).items()}
