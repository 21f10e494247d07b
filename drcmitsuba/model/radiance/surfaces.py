"""Surfaces as they are read: polygons and facets by their modifier, and their copies."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance import bodies, polygons
from drcmitsuba.model.radiance.definitions import SURFACES, Definition, Moved
from drcmitsuba.model.radiance.text import FileLine, Primitive
from drcmitsuba.model.radiance.xform import Moves, reversed_front

MOST_MOVED = 10_000
"""Largest number of copies of a definition that moves with them."""


class Patch(NamedTuple):
    """Quads of one modifier."""

    quads: np.ndarray
    """Shape (quad, 4, 3) [m]."""
    polygon: np.ndarray
    """Index of the source's polygon that each is part of, int, shape (quad,)."""
    places: tuple[str, ...]
    """Where each polygon stands."""

    def copied(self, moves: Moves) -> Patch:
        """Copies by moves, each with polygons of its own."""
        quads = moves.of(self.quads).reshape(-1, 4, 3)
        first = len(self.places) * np.arange(len(moves))
        polygon = (self.polygon + first[:, None]).ravel()
        return Patch(quads, polygon, self.places * len(moves))


def joined(patches: Sequence[Patch]) -> Patch:
    """Patches as one."""
    first = np.cumsum([0, *(len(patch.places) for patch in patches[:-1])])
    index = [patch.polygon + start for patch, start in zip(patches, first, strict=True)]
    places = tuple(place for patch in patches for place in patch.places)
    return Patch(np.concatenate([p.quads for p in patches]), np.concatenate(index), places)


@dataclass
class _Polygons:
    """Polygons of one modifier before they are cut."""

    corners: array = field(default_factory=lambda: array("d"))
    counts: array = field(default_factory=lambda: array("q"))
    names: list[str] = field(default_factory=list)
    lines: array = field(default_factory=lambda: array("q"))
    files: list[Path] = field(default_factory=list)

    def place(self, index: int) -> FileLine:
        """Line on which a polygon stands."""
        return FileLine(self.files[index], self.lines[index])


EMPTY = "Polygons without area are left out"


class SurfacesByModifier:
    """Surfaces by their modifier; None stands for void."""

    def __init__(self, notes: Notes) -> None:
        self.notes = notes
        self._polygons: dict[Definition | None, _Polygons] = {}
        self._patches: dict[Definition | None, list[Patch]] = {}

    def add(self, primitive: Primitive, definition: Definition | None) -> int:
        """Take in a surface, and return the number of triangles or facets that it becomes.

        Raises
        ------
        InputError
            The number of its arguments is wrong, or it has no area.
        """
        kind, numbers = primitive.kind, primitive.numbers
        wanted = SURFACES[kind]
        if wanted is None:
            if len(numbers) < 9 or len(numbers) % 3:
                got = f"{len(numbers)} numbers"
                raise primitive.error(got, "give three for each of three corners or more")
            waiting = self._polygons.setdefault(definition, _Polygons())
            waiting.corners.extend(numbers)
            waiting.counts.append(len(numbers) // 3)
            waiting.names.append(primitive.name)
            waiting.lines.append(primitive.place.line)
            waiting.files.append(primitive.place.file)
            return len(numbers) // 3 - 2
        if len(numbers) != wanted:
            raise primitive.error(f"{len(numbers)} numbers", f"give {wanted}")
        quads = facets(primitive)
        self.add_facets(quads, definition, primitive.place.of(primitive.name))
        return len(quads)

    def add_facets(self, quads: np.ndarray, definition: Definition | None, place: str) -> None:
        """Take in quads (quad, 4, 3) of one body."""
        patch = Patch(quads, np.zeros(len(quads), np.int64), (place,))
        self._patches.setdefault(definition, []).append(patch)

    def patches(self) -> dict[Definition | None, Patch]:
        """Quads of each modifier.

        Raises
        ------
        InputError
            A polygon is not planar, or crosses itself. One without area is left out with a note.
        """
        for definition, waiting in self._polygons.items():

            def refuse(index: int, got: str, waiting: _Polygons = waiting) -> Exception:
                field = f"polygon {waiting.names[index]!r}"
                return waiting.place(index).error(field, got, "correct or remove it")

            def leave_out(index: int, waiting: _Polygons = waiting) -> None:
                self.notes.add(EMPTY, waiting.place(index).of(waiting.names[index]))

            corners = np.frombuffer(waiting.corners).reshape(-1, 3)
            quads, index = polygons.cut(corners, np.array(waiting.counts), refuse, leave_out)
            places = tuple(waiting.place(i).of(name) for i, name in enumerate(waiting.names))
            self._patches.setdefault(definition, []).append(Patch(quads, index, places))
        self._polygons = {}
        self._patches = {key: [joined(patches)] for key, patches in self._patches.items()}
        return {key: patches[0] for key, patches in self._patches.items()}

    def add_copies(
        self, patches: dict[Definition | None, Patch], moves: Moves, since: int, place: FileLine
    ) -> None:
        """Take in copies of patches; definitions since a position move with them.

        More than 10,000 copies of a film or a solid that is defined among them raise InputError.
        """
        for definition, patch in patches.items():
            if definition is None or definition.moved(moves.one(0), since, {}) is definition:
                self._patches.setdefault(definition, []).append(patch.copied(moves))
                continue
            if len(moves) > MOST_MOVED:
                got = f"{len(moves)} copies of {definition.name!r}, which moves with each"
                raise place.error("xform", got, "define it outside the array")
            for copy in range(len(moves)):
                one = moves.one(copy)
                done: Moved = {}
                moved = definition.moved(one, since, done)
                self._patches.setdefault(moved, []).append(patch.copied(one))


def facets(primitive: Primitive) -> np.ndarray:
    """Facets (quad, 4, 3) of a sphere, cylinder, cone, ring or one of their inverses.

    Raises
    ------
    InputError
        The body has no area.
    """
    values = np.array(primitive.numbers)
    if not (np.abs(values) <= polygons.LARGEST).all():
        raise primitive.error("a number that is not finite, or too large", "correct it")
    kind = primitive.kind
    inward = kind in ("bubble", "tube", "cup")
    try:
        if kind == "ring":
            if (values[6:] < 0).any():
                raise ValueError("a radius below 0")
            return bodies.ring(values[:3], values[3:6], (values[6], values[7]))
        # A negative radius turns the front round.
        radii = values[3:4] if kind in ("sphere", "bubble") else values[6:]
        if (radii < 0).any():
            if (radii > 0).any():
                raise ValueError("radii of different sign")
            inward, radii = not inward, -radii
        if kind in ("sphere", "bubble"):
            if radii[0] == 0:
                raise ValueError("no area")
            quads = bodies.sphere(values[:3], radii[0])
        else:
            quads = bodies.cone(values[:3], values[3:6], (radii[0], radii[-1]))
    except ValueError as error:
        raise primitive.error(str(error), "correct or remove it") from None
    return reversed_front(quads) if inward else quads
