"""Surfaces of a gbXML building, with their openings cut out, as layers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from drcmitsuba.model.gbxml.entries import GbxmlEntry
from drcmitsuba.model.gbxml.gaps import LEAST as LEAST_GAP
from drcmitsuba.model.gbxml.gaps import gaps_of
from drcmitsuba.model.gbxml.materials import WindowType
from drcmitsuba.model.gbxml.spaces import is_ceiling, is_floor
from drcmitsuba.model.materials import GlazingMaterial, two_sided
from drcmitsuba.model.model import Layer, Role
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.plane import Plane, Rings
from drcmitsuba.model.polygon import NoAreaError, area_vector, closes, quads_of
from drcmitsuba.model.shared_walls import (
    COVERED,
    UNSTATED,
    RoomFace,
    sheets_of,
    single_panes,
    uncovered,
)
from drcmitsuba.model.unstated import GLASS, glass, surface_material

OPEN = "Air"
"""Kind of a surface or an opening that is no surface."""
CONTEXT = ("Shade",)
SHADES = ("shade", "shade")
"""Names of both sides of a shade."""
DOORS = ("NonSlidingDoor", "SlidingDoor")
OFF_PLANE = 0.05
"""Largest distance of an opening from the plane of its surface [m]."""
BEYOND = "Openings are cut at the edge of their surface beyond which they reach"
INWARD = "Spaces whose surfaces face inward are taken the other way round"
CLOSED = "Gaps between the surfaces of spaces are closed by opaque ones"
TOUCHING = 0.01
"""Distance within which surfaces of two spaces lie in one place [m]."""
NEARLY = 0.02
"""Part of the area around a space that may be missing where its polygons close."""
LEAST = 1e-6
"""Area below which a polygon is left out [m²]."""


class OneSided(NamedTuple):
    """Polygon of a surface that names one space."""

    place: str
    space: str
    side: str
    """Name of its side towards the space."""
    rings: Rings


@dataclass
class GbxmlSurfaces:
    """Polygons of a file by their materials, and around each space."""

    windows: Mapping[str, WindowType]
    """Window types by their identifiers."""
    spaces: frozenset[str]
    """Identifiers of the spaces."""
    metres: float
    notes: Notes
    turned: frozenset[str] = frozenset()
    """Spaces whose polygons face inward, see `inside_out`."""
    faces: dict[str, list[np.ndarray]] = field(default_factory=dict)
    """Polygons around each space by its identifier, counter-clockwise from its outside [m]."""
    sorts: dict[tuple[str, str], list[tuple[str, Rings]]] = field(default_factory=dict)
    """Places and polygons by the names of their front and back."""
    alone: list[OneSided] = field(default_factory=list)
    """Polygons of surfaces that name one space."""
    panes: dict[WindowType, list[tuple[str, Rings]]] = field(default_factory=dict)
    """Places and polygons of windows by their types."""
    glass: dict[WindowType, GlazingMaterial] = field(default_factory=dict)

    def add(self, surface: GbxmlEntry) -> None:
        """Add a surface, whose polygon faces out of its first space.

        Raises
        ------
        InputError
            It names a space that is not there, its polygon is unfit, or an opening lies off it.
        """
        kind = surface.attribute("surfaceType")
        ring = surface.ring() * self.metres
        named = [each.attribute("spaceIdRef") for each in surface.children("AdjacentSpaceId")]
        for name in named:
            if name not in self.spaces:
                got = f"the space {name!r}, which the file lacks"
                raise surface.refuse("AdjacentSpaceId", got, "name a Space of the file")
        if named and self.turned.issuperset(named[:2]):
            ring = ring[::-1]
        for name, own in zip(named[:2], (ring, ring[::-1]), strict=False):
            self.faces.setdefault(name, []).append(own)
        if float(np.linalg.norm(area_vector(ring))) < LEAST:
            self.notes.add("Surfaces without area are left out", surface.place)
            return
        parts = self._opened(surface, ring)
        if kind == OPEN:
            return
        if len(named) == 1 and kind not in CONTEXT:
            self.alone += [OneSided(surface.place, named[0], _side(ring), own) for own in parts]
            return
        names = SHADES if not named or kind in CONTEXT else _sides(ring)
        self.sorts.setdefault(names, []).extend((surface.place, rings) for rings in parts)

    def _opened(self, surface: GbxmlEntry, ring: np.ndarray) -> list[Rings]:
        """Polygons that the openings of a surface leave of it; adds these."""
        plane = Plane.of(ring)
        whole = plane.shape([ring])
        rest = whole
        for opening in surface.children("Opening"):
            corners = opening.ring() * self.metres
            off = plane.distance(corners)
            if off > OFF_PLANE:
                got = f"a corner {off:.2f} m off the plane of {surface.place}"
                raise opening.refuse("PlanarGeometry", got, "put it into its surface")
            shape = plane.shape([corners])
            inside = whole.intersection(shape)
            if inside.area < LEAST:
                got = f"it lies beside {surface.place}"
                raise opening.refuse("PlanarGeometry", got, "put it into its surface")
            if inside.area < (1 - 1e-3) * shape.area:
                self.notes.add(BEYOND, opening.place)
            if self._is_wall(opening):
                continue
            rest = rest.difference(inside)
            if opening.attribute("openingType") != OPEN:
                kind = self._type(opening)
                mine = [(opening.place, own) for own in plane.rings(inside, LEAST)]
                self.panes.setdefault(kind, []).extend(mine)
        return plane.rings(rest, LEAST)

    def _is_wall(self, opening: GbxmlEntry) -> bool:
        """Whether an opening is a door without glass, which the wall stands for."""
        is_door = opening.attribute("openingType") in DOORS
        return is_door and not opening.attribute("windowTypeIdRef")

    def _type(self, opening: GbxmlEntry) -> WindowType:
        """Window type of an opening, of which the glass is known then."""
        kind = opening.attribute("windowTypeIdRef")
        if kind and kind not in self.windows:
            got = f"{kind!r}, which the file lacks"
            raise opening.refuse("windowTypeIdRef", got, "name a WindowType of the file")
        window = self.windows[kind] if kind else WindowType(GLASS, None)
        if window not in self.glass:
            self.glass[window] = glass(window.transmittance, window.name, self.notes)
        return window

    def close(self, spaces: Sequence[GbxmlEntry]) -> None:
        """Close the gaps of spaces by surfaces, which have the same on both sides; notes them."""
        covers: list[Rings] = [(ring,) for rings in self.faces.values() for ring in rings]
        for space in spaces:
            rings = self.faces.setdefault(space.attribute("id"), [])
            gaps = [
                part
                for parts in uncovered(gaps_of(rings), covers, TOUCHING)
                for part in parts
                if Plane.of(part[0]).polygon(part).area > LEAST_GAP
            ]
            if not gaps:
                continue
            covers += gaps
            name = space.text("Name") or space.attribute("id")
            area = sum(float(Plane.of(gap[0]).polygon(gap).area) for gap in gaps)
            self.notes.add(CLOSED, f"{name} ({area:.2f} m²)")
            middle = np.concatenate(rings)[:, 2]
            has_floor = any(map(is_floor, rings))
            for gap in gaps:
                level = is_floor(gap[0]) or is_ceiling(gap[0])
                high = gap[0][:, 2].mean() > (middle.min() + middle.max()) / 2
                side = ("ceiling" if high else "floor") if level else "wall"
                if side == "floor" and not has_floor:  # else files count it to no space
                    rings.append(gap[0] if is_floor(gap[0]) else gap[0][::-1])
                piece = f"gap of Space {space.attribute('id')}", gap
                self.sorts.setdefault((side, side), []).append(piece)

    def _sort_alone(self) -> None:
        """Sort the polygons that name one space; what two of them share has a side for each."""
        faces = [RoomFace(each.rings, each.space) for each in self.alone]
        for own, sheets in zip(self.alone, sheets_of(faces, TOUCHING), strict=True):
            for rings, other in sheets:
                names = "outside", own.side
                if other is not None:
                    behind = self.alone[other]
                    self.notes.add(UNSTATED, f"{own.place} and {behind.place}")
                    names = own.side, behind.side  # the front of such a part faces its own space
                self.sorts.setdefault(names, []).append((own.place, rings))

    def _uncover_panes(self) -> None:
        """Leave out parts of panes that lie on panes or surfaces of other spaces."""
        panes = [(kind, *pane) for kind, pieces in self.panes.items() for pane in pieces]
        walls = [rings for names, own in self.sorts.items() if names != SHADES for _, rings in own]
        parts = single_panes([rings for _, _, rings in panes], walls, TOUCHING)
        self.panes = {kind: [] for kind in self.panes}
        for (kind, place, rings), left in zip(panes, parts, strict=True):
            if len(left) != 1 or left[0] is not rings:
                self.notes.add(COVERED, place)
            self.panes[kind] += [(place, own) for own in left]

    def _uncover_shades(self) -> None:
        """Leave out parts of shades that lie on surfaces of spaces, whose rooms would see them."""
        shades = self.sorts.pop(SHADES, [])
        covers = [rings for pieces in self.sorts.values() for _, rings in pieces]
        covers += [rings for pieces in self.panes.values() for _, rings in pieces]
        parts = uncovered([rings for _, rings in shades], covers, TOUCHING)
        left = [(place, one) for (place, _), own in zip(shades, parts, strict=True) for one in own]
        if left:
            self.sorts[SHADES] = left

    def layers(self) -> Iterator[Layer]:
        """Layers of the surfaces, then of the windows."""
        self._sort_alone()
        self._uncover_panes()
        self._uncover_shades()
        for (front, back), pieces in self.sorts.items():
            quads, polygon, places = self._quads(pieces)
            if not len(quads):
                continue
            material = surface_material(front)
            if back != front:
                material = two_sided(material, surface_material(back))
            role: Role = "context" if (front, back) == SHADES else "surface"
            behind = back if back != front else ""
            yield Layer(front, material, role, quads, polygon, places, behind=behind)
        for kind, pieces in self.panes.items():
            quads, polygon, places = self._quads(pieces)
            if len(quads):
                yield Layer(kind.name, self.glass[kind], "pane", quads, polygon, places)

    def _quads(
        self, pieces: Sequence[tuple[str, Rings]]
    ) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        """Quads [m], the polygon of each, and the places of the polygons."""
        parts, polygons = [np.empty((0, 4, 3))], [np.empty(0, int)]
        for k, (place, (outline, *holes)) in enumerate(pieces):
            try:
                quads = quads_of(outline, holes)
            except NoAreaError:
                self.notes.add("Surfaces without area are left out", place)
                continue
            except ValueError:
                self.notes.add("Surfaces whose outline crosses itself are left out", place)
                continue
            parts.append(quads)
            polygons.append(np.full(len(quads), k))
        places = tuple(place for place, _ in pieces)
        return np.concatenate(parts), np.concatenate(polygons), places


def inside_out(surfaces: Sequence[GbxmlEntry]) -> frozenset[str]:
    """Identifiers of spaces whose polygons face inward in the main, where they close.

    A polygon with area vector A faces outward where A · (x − c) > 0, with its middle x and that of
    all of the space's corners c; area vectors around a space add up to 0.
    """
    rings: dict[str, list[np.ndarray]] = {}
    for surface in surfaces:
        ring = surface.ring()
        for each, side in zip(
            surface.children("AdjacentSpaceId"), (ring, ring[::-1]), strict=False
        ):
            rings.setdefault(each.attribute("spaceIdRef"), []).append(side)
    out = set[str]()
    for name, around in rings.items():
        corners = np.concatenate(around)
        areas = np.array([area_vector(side) for side in around])
        middles = np.array([side.mean(axis=0) for side in around]) - corners.mean(axis=0)
        least = NEARLY * np.linalg.norm(areas, axis=1).sum() * np.ptp(corners, axis=0).max()
        if closes(areas, NEARLY) and (areas * middles).sum() < -least:
            out.add(name)
    return frozenset(out)


def _side(ring: np.ndarray) -> str:
    """Name of the side of a surface towards the space out of which it faces."""
    if is_floor(ring) == is_ceiling(ring):
        return "wall"
    return "floor" if is_floor(ring) else "ceiling"


def _sides(ring: np.ndarray) -> tuple[str, str]:
    """Names of front and back of a surface that faces out of the first of its two spaces."""
    return _side(ring[::-1]), _side(ring)
