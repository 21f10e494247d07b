"""Visibility of suns: whether each can light a room; in doubt it can.

A sun lights the room if it stands before an opening that no surface hides entirely, or if it shines
on a surface outside that may pass its light on to an opening. Both follow from half-spaces: two
surfaces exchange light only where each has a corner before the other. Shadows between surfaces
outside are left out: they could only exclude more suns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.furniture import Furniture
from drcmitsuba.model.materials import DielectricMaterial
from drcmitsuba.model.model import areas
from drcmitsuba.scene.components import PlacedComponent
from drcmitsuba.scene.components.placement import panes_of
from drcmitsuba.scene.geometry import (
    box,
    boxes,
    faces_of,
    is_triangle,
    normals,
    origin,
    reversed_quads,
    rotation,
)
from drcmitsuba.scene.materials import albedo, lets_through, max_reflectance
from drcmitsuba.scene.panes_of_model import panes_of_model

MOST_FACES = 400
"""Largest number of surfaces outside for an exchange; with more, every sun lights the room."""
MOST_BLOCKERS = 64
"""Largest number of surfaces outside that may hide an opening, the largest first."""
BEFORE = 1e-6
"""Least distance before a plane [m]."""


@dataclass(frozen=True)
class VisibleSuns:
    """Suns that light a room."""

    mask: np.ndarray
    """Whether each sun lights the room, shape (sun,)."""
    behind: int
    """Number of suns before no opening."""
    hidden: int
    """Number of suns that are hidden by surfaces outside."""
    largest: float
    """Largest n·s of an opening's outward normal and a sun; −1 without openings."""


@dataclass(frozen=True)
class SunVisibility:
    """Geometry that decides whether a sun lights a room, in the world frame."""

    openings: np.ndarray
    """Panes, holes and ports, fronts outward [m], shape (opening, 4, 3)."""
    relays: np.ndarray
    """Outward normals, shape (relay, 3), of surfaces outside that may pass light to an opening."""
    blockers: np.ndarray
    """Opaque parallelograms outside [m], shape (blocker, 4, 3)."""
    everything: bool = False
    """Whether more than `MOST_FACES` surfaces stand outside: every sun then lights the room."""

    @classmethod
    def of(cls, case: Case, components: tuple[PlacedComponent, ...]) -> SunVisibility | None:
        """SunVisibility of a case; None without a room: its sensors are in the open."""
        if case.building.layers:
            return cls._of_model(case)
        if case.room is None:
            return None
        turn = rotation(case)
        panes = [pane[::-1] for panes in panes_of(case).values() for pane in panes]
        standing, size = outside(case), np.array(case.room.size)
        ports = [port.quad[::-1] for placed in components for port in placed.ports]
        ports = [q for q in ports if ((q < BEFORE) | (q > size - BEFORE)).any()]
        openings = np.reshape([*panes, *ports], (-1, 4, 3)) @ turn.T
        blockers = (
            np.reshape([q for piece in standing for q in faces_of(piece)], (-1, 4, 3)) @ turn.T
        )
        blockers = blockers[np.argsort(-areas(blockers), kind="stable")[:MOST_BLOCKERS]]
        bright = [piece for piece in standing if max_reflectance(piece.reflectance) > 0]
        pieces = [q for piece in bright for q in faces_of(piece)]
        parts = [s for placed in components for s in placed.surfaces if albedo(s.material) > 0]
        pieces += [q for s in parts for q in s.quads if ((q < -BEFORE) | (q > size + BEFORE)).any()]
        faces = np.reshape([*pieces, *box(np.zeros(3), size)], (-1, 4, 3)) @ turn.T
        faces = faces[areas(faces) > 0]
        everything = len(faces) > MOST_FACES
        if everything or not pieces:
            return cls(openings, np.zeros((0, 3)), blockers, everything)
        return cls(openings, _relays(faces, openings), blockers)

    @classmethod
    def _of_model(cls, case: Case) -> SunVisibility | None:
        """SunVisibility of a model: any of its surfaces may pass light on to its panes."""
        panes, start, turn = panes_of_model(case.building), origin(case), rotation(case).T
        assert case.model is not None
        if case.model.leaks == "allow":
            return None
        layers = case.building.layers
        # Light enters by clear solids, too; a box stands for each.
        solids = [_around(x.quads) for x in layers if isinstance(x.material, DielectricMaterial)]
        frames = np.concatenate([reversed_quads(panes.frame[panes.outside]), *solids])
        openings = (frames - start) @ turn
        always = [layer for layer in layers if layer.role == "context" and not layer.stands_in]
        context = [
            layer.quads
            for layer in always
            if all(m is not None and not lets_through(m) for m in layer.materials)
        ]
        blockers = np.concatenate([np.zeros((0, 4, 3)), *context])
        blockers = blockers[~is_triangle(blockers)] if len(blockers) else blockers
        order = np.argsort(-areas(blockers), kind="stable")[:MOST_BLOCKERS]
        blockers = (blockers[order] - start) @ turn
        every = [*layers, *(shade for layer in layers for shade in layer.added)]
        if sum(len(layer.quads) for layer in every) > MOST_FACES:
            return cls(openings, np.zeros((0, 3)), blockers, everything=True)
        bright = [
            layer.quads
            for layer in every
            if any(m is not None and albedo(m) > 0 for m in layer.materials)
        ]
        faces = np.concatenate([np.zeros((0, 4, 3)), *bright])
        return cls(openings, _relays((faces - start) @ turn, openings), blockers)

    @property
    def normals(self) -> np.ndarray:
        """Unit normals of the openings, outward, shape (opening, 3)."""
        return normals(self.openings)

    def visible(self, suns: np.ndarray, diameter: float) -> VisibleSuns:
        """Decide which suns (sun, 3) light the room; `diameter` is the angle across one [deg]."""
        radius = np.radians(diameter) / 2
        least = -np.sin(radius)
        cosines = self.normals @ suns.T
        before = cosines > least
        passed_on = (self.relays @ suns.T > least).any(axis=0) | self.everything
        ahead = before.any(axis=0) | passed_on
        mask = passed_on if len(self.blockers) else ahead
        for opening, lit in zip(self.openings, before, strict=True):
            at = np.flatnonzero(lit & ~mask)
            for blocker in self.blockers:
                if len(at):
                    at = at[~_hidden(opening, blocker, suns[at], radius)]
            mask[at] = True
        largest = float(cosines.max()) if cosines.size else -1.0
        return VisibleSuns(mask, int((~ahead).sum()), int((ahead & ~mask).sum()), largest)


def reaches_in(case: Case, faces: np.ndarray) -> np.ndarray:
    """Whether the bounds of each polygon (face, corner, 3) overlap the room, shape (face,)."""
    if case.room is None:
        return np.zeros(len(faces), bool)
    low, high = faces.min(axis=1), faces.max(axis=1)
    size = np.array(case.room.size)
    return ((high > BEFORE) & (low < size - BEFORE)).all(axis=1)


def outside(case: Case) -> list[Furniture]:
    """Pieces of furniture at least partly outside the room; all of them without a room."""
    if case.room is None:
        return list(case.furniture)
    size = np.array(case.room.size)
    return [
        piece
        for piece in case.furniture
        if any(((c < -BEFORE) | (c + s > size + BEFORE)).any() for c, s in boxes(piece))
    ]


def _around(quads: np.ndarray) -> np.ndarray:
    """Faces (6, 4, 3) of the bounding box of quads, fronts outward."""
    low, high = quads.min(axis=(0, 1)) - BEFORE, quads.max(axis=(0, 1)) + BEFORE
    return np.array(box(low, high - low))


def _relays(faces: np.ndarray, openings: np.ndarray) -> np.ndarray:
    """Normals (side, 3) of the sides of faces (face, 4, 3) that may pass light to openings."""
    sides, n = np.concatenate([faces, faces]), normals(faces)
    of_sides, of_openings = np.concatenate([n, -n]), normals(openings)

    def exchange(a: np.ndarray, na: np.ndarray, b: np.ndarray, nb: np.ndarray) -> np.ndarray:
        """Whether each quad of a and each of b have a corner before the other, shape (a, b)."""
        own_a, own_b = (np.einsum("ai,ai->a", n, q[:, 0]) for n, q in ((na, a), (nb, b)))
        before_a = np.einsum("ai,bci->abc", na, b) - own_a[:, None, None]
        before_b = np.einsum("bi,aci->abc", nb, a) - own_b[None, :, None]
        return np.asarray((before_a > BEFORE).any(axis=2) & (before_b > BEFORE).any(axis=2))

    passes = np.asarray(exchange(sides, of_sides, openings, of_openings).any(axis=1))
    between = exchange(sides, of_sides, sides, of_sides)
    while True:
        more = passes | (between & passes).any(axis=1)
        if np.array_equal(more, passes):
            return of_sides[passes]
        passes = more


def _hidden(
    opening: np.ndarray, blocker: np.ndarray, suns: np.ndarray, radius: float
) -> np.ndarray:
    """Whether a parallelogram hides all of an opening from all of each sun, shape (sun,).

    It does where rays from the opening's corners to a sun meet the parallelogram, farther from its
    edges than the sun's radius moves them: rays from the rest of the opening then meet it, too.
    """
    n = normals(blocker[None])[0]
    u, v = blocker[1] - blocker[0], blocker[3] - blocker[0]
    across = suns @ n
    steep = np.abs(across) > 4 * np.sin(radius) + 1e-6
    safe = np.where(steep, across, 1.0)
    covered = steep.copy()
    to_plane = (blocker[0] - opening) @ n
    outermost = np.maximum(np.cos(np.arccos(np.minimum(np.abs(safe), 1)) + radius), 1e-6)
    for corner, height in zip(opening, to_plane, strict=True):
        t = height / safe
        at = corner + t[:, None] * suns - blocker[0]
        covered &= t > BEFORE
        margin = np.abs(height) * np.sin(radius) / (np.abs(safe) * outermost) + 1e-3
        for edge in (u, v):
            length = np.linalg.norm(edge)
            along = at @ edge / length
            covered &= (along > margin) & (along < length - margin)
    return covered
