"""Nodes, elements and their sets in decks of CalculiX and Abaqus (.inp), universal files (.unv), and by meshio."""

from __future__ import annotations

import io
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stickslip.geometry.arrays import Ints
from stickslip.geometry.errors import GeometryError, shortened

# number of nodes of Abaqus' flat elements, trusses and solids -> meshio's name
FLAT = {3: "triangle", 6: "triangle6", 4: "quad", 8: "quad8"}
THIN = {2: "line", 3: "line3"}
SOLID = {4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20", 6: "wedge", 15: "wedge15", 5: "pyramid"}
ABAQUS = re.compile(r"(?:D?C3D(\d+)|(?:CPS|CPE|CPEG|CAX|CGAX|DC2D|DCAX|M3D|SFM3D|R3D|STRI|S)(\d)|T[23]D(\d)).*")
UNIVERSAL = {  # descriptors of elements in .unv -> meshio's name, and the order of its nodes
    (11, 21): ("line", (0, 1)),
    (22, 24): ("line3", (0, 2, 1)),
    (41, 51, 61, 81, 91): ("triangle", (0, 1, 2)),
    (42, 52, 62, 82, 92): ("triangle6", (0, 2, 4, 1, 3, 5)),
    (44, 54, 64, 84, 94): ("quad", (0, 1, 2, 3)),
    (45, 55, 65, 85, 95): ("quad8", (0, 2, 4, 6, 1, 3, 5, 7)),
    (111,): ("tetra", (0, 1, 2, 3)),
    (118,): ("tetra10", (0, 2, 4, 9, 1, 3, 5, 6, 7, 8)),
    (112,): ("wedge", (0, 1, 2, 3, 4, 5)),
    (113,): ("wedge15", (0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8)),
    (115,): ("hexahedron", (0, 1, 2, 3, 4, 5, 6, 7)),
    (116,): ("hexahedron20", (0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11)),
}
NODES, ELEMENTS, MEMBERS = (781, 2411), 2412, (2435, 2452, 2467, 2477)  # datasets of .unv
OF_ELEMENTS = 8  # kind of members
BEAMS = (11, 21, 22, 24)  # descriptors that a line of orientations follows


@dataclass(eq=False)
class Content:
    """What a file says; nodes and elements go by its own numbers."""

    points: dict[int, Sequence[float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, Sequence[int]]] = field(default_factory=dict)  # meshio's name, nodes in its order
    groups: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))  # of elements
    nodes: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    surfaces: dict[str, list[tuple[int, str]]] = field(default_factory=lambda: defaultdict(list))  # element and S1 ...
    sections: list[str] = field(default_factory=list)  # groups that have a material


def read_foreign(path: Path) -> Content:
    """Read a file by its ending."""
    content, suffix = Content(), path.suffix.lower()
    read = _read_inp if suffix == ".inp" else _read_unv if suffix == ".unv" else _read_meshio
    read(path, content)
    return content


Options = Mapping[str, str]  # of a keyword
Lines = Sequence[Sequence[str]]


def _read_inp(path: Path, content: Content, within: Sequence[Path] = ()) -> None:
    """Read nodes, elements, sets, surfaces and sections of a deck, and of those that it includes.

    Args:
        within: the decks that include it.
    """
    if path in within:
        raise GeometryError(f"includes itself: {shortened(path.name)}")
    blocks = list[tuple[str, dict[str, str], list[list[str]]]]()
    for line in path.read_text(encoding="latin-1").splitlines():
        words = [word.strip().strip('"').upper() for word in line.split(",")]
        if line.startswith("**") or not line.strip():
            continue
        if line.startswith("*"):
            options = [word.partition("=") for word in words[1:]]
            blocks.append((words[0][1:], {key.strip(): value.strip() for key, _, value in options}, []))
            if words[0] == "*INCLUDE":
                _read_inp((path.parent / line.partition("=")[2].strip().strip('"')).resolve(), content, (*within, path))
        elif blocks:
            blocks[-1][2].append([word for word in words if word])
    for keyword, options_of, lines in blocks:
        if keyword in KEYWORDS:
            KEYWORDS[keyword](content, options_of, lines)


def _nodes(content: Content, options: Options, lines: Lines) -> None:
    for number, *words in lines:
        x = (*map(float, words), 0.0, 0.0, 0.0)[:3]
        if content.points.setdefault(int(number), x) != x:
            raise GeometryError(f"has two nodes {number}: expected a deck of one part")
    content.nodes[options.get("NSET", "")] += [int(line[0]) for line in lines]


def _elements(content: Content, options: Options, lines: Lines) -> None:
    found = ABAQUS.fullmatch(options.get("TYPE", ""))
    if found is None:
        return  # springs, masses
    count = int(found[1] or found[2] or found[3])
    kind = (SOLID if found[1] else FLAT if found[2] else THIN).get(count)
    if kind is None:
        raise GeometryError(f"is made of cells that cannot be used, {options['TYPE']}")
    row = list[int]()
    for line in lines:
        row += map(int, line)
        if len(row) > count:  # more nodes on the same line are of no account
            content.elements[row[0]] = (kind, row[1 : count + 1])
            content.groups[options.get("ELSET", "")].append(row[0])
            row = []


def _set(sets: dict[str, list[int]], name: str, options: Options, lines: Lines) -> None:
    for line in lines:
        if "GENERATE" in options:
            first, end, *step = map(int, line)
            sets[name] += range(first, end + 1, *step)
        else:
            sets[name] += [n for word in line for n in ([int(word)] if word.isdigit() else sets[word])]


def _surface(content: Content, options: Options, lines: Lines) -> None:
    if options.get("TYPE", "ELEMENT") == "ELEMENT":
        for member, *facet in lines:
            numbers = [int(member)] if member.isdigit() else content.groups[member]
            content.surfaces[options["NAME"]] += [(number, word) for number in numbers for word in facet[:1]]


KEYWORDS: Mapping[str, Callable[[Content, Options, Lines], None]] = {
    "NODE": _nodes,
    "ELEMENT": _elements,
    "NSET": lambda content, options, lines: _set(content.nodes, options["NSET"], options, lines),
    "ELSET": lambda content, options, lines: _set(content.groups, options["ELSET"], options, lines),
    "SURFACE": _surface,
    "SOLID SECTION": lambda content, options, lines: content.sections.append(options.get("ELSET", "")),
}


def _read_unv(path: Path, content: Content) -> None:
    """Read nodes, elements and groups of a universal file."""
    lines = iter(path.read_text(encoding="latin-1").splitlines())
    for line in lines:
        if line.strip() == "-1":
            dataset = int(next(lines))
            rows = iter([*iter(lambda: next(lines, "-1").strip(), "-1")])
            if dataset in NODES:
                for head in rows:
                    x = next(rows).upper().replace("D", "E").split()
                    content.points[int(head.split()[0])] = tuple(map(float, x))
            elif dataset == ELEMENTS:
                _universal_elements(rows, content)
            elif dataset in MEMBERS:
                for head in rows:
                    name, members = next(rows), _numbers(rows, 4 * int(head.split()[-1]))
                    for kind, number in zip(members[::4], members[1::4], strict=True):
                        (content.groups if kind == OF_ELEMENTS else content.nodes)[name].append(number)


def _universal_elements(rows: Iterator[str], content: Content) -> None:
    kinds = {number: kind for numbers, kind in UNIVERSAL.items() for number in numbers}
    for head in rows:
        number, descriptor, *_, count = map(int, head.split())
        if descriptor in BEAMS:
            next(rows)
        nodes = _numbers(rows, count)
        if descriptor in kinds:
            kind, order = kinds[descriptor]
            content.elements[number] = (kind, [nodes[k] for k in order])


def _numbers(rows: Iterator[str], count: int) -> list[int]:
    """Take lines until they have so many numbers."""
    found = list[int]()
    while len(found) < count:
        found += map(int, next(rows).split())
    return found


def in_order_of_gmsh(kind: str, rows: Ints) -> Ints:
    """Return nodes (c, k) of elements of meshio's kind in gmsh's order."""
    from meshio.gmsh.common import _meshio_to_gmsh_order  # late: few files need it

    return np.asarray(_meshio_to_gmsh_order(kind, rows), np.int64)


def _read_meshio(path: Path, content: Content) -> None:
    """Read a mesh of any kind that meshio reads, with its sets, Salome's families, or an array of whole numbers."""
    os.environ["HDF5_USE_FILE_LOCKING"] = "FALSE"  # the process may not lock files
    import meshio  # late: few files need it

    from stickslip.geometry.user_files.hdf5_datasets import refuse_others

    if path.suffix.lower() == ".bdf":  # meshio wants two lines that other programs leave out
        text = path.read_text(encoding="latin-1")
        text = text if "BEGIN BULK" in text else f"BEGIN BULK\n{text}"
        mesh = meshio.read(io.StringIO(f"{text}\nENDDATA\n"), "nastran")
    else:
        if path.suffix.lower() == ".med":
            refuse_others(path)
        mesh = meshio.read(path)
    content.points = dict(enumerate(np.atleast_2d(mesh.points).tolist()))
    first = np.cumsum([0, *(len(block.data) for block in mesh.cells)])
    for block, start in zip(mesh.cells, first, strict=False):
        content.elements |= {int(start) + k: (block.type, nodes) for k, nodes in enumerate(block.data.tolist())}
    for name, parts in mesh.cell_sets.items():
        content.groups[name] += [int(k) for part, start in zip(parts, first, strict=False) for k in start + part]
    for name, part in mesh.point_sets.items():
        content.nodes[name] += map(int, part)
    for target, data, families in (
        (content.groups, {name: np.concatenate(list(map(np.ravel, parts))) for name, parts in mesh.cell_data.items()},
         getattr(mesh, "cell_tags", {})),
        (content.nodes, mesh.point_data, getattr(mesh, "point_tags", {})),
    ):  # fmt: skip
        whole = [x for name, x in data.items() if np.issubdtype(x.dtype, np.integer) and x.ndim == 1
                 and not name.startswith("vtk") and len(np.unique(x)) < len(x)]  # fmt: skip
        if not target and whole and (target is content.groups or families):
            for value in np.unique(whole[0]).tolist():
                for name in families.get(value, [] if families else [str(value)]):
                    target[name] += np.flatnonzero(whole[0] == value).tolist()
