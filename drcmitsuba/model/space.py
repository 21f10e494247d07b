"""Rooms of a building by name, as files of models and cases state them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from drcmitsuba.model.notes import Notes
from drcmitsuba.model.plane import Rings
from drcmitsuba.model.polygon import area_vector

LEVEL = 0.05
"""Difference in height below which floors are one [m]."""
HEADROOM = 1.0
"""Least height above a floor [m]."""
SEAM = 0.02
"""Distance within which points count as inside of a room, and seams of its floor are closed [m]."""
SAME_LEVEL = 0.5
"""Difference in height within which floors that overlap are in each other's way [m]."""
OVERLAP = 0.01
"""Share of the smaller floor that may lie in another space [–]."""
OVERLAPPING = "Floors of spaces overlap; sensors there belong to one of them"


class SpaceFloor(NamedTuple):
    """Floor of a space, of which it may have several."""

    height: float
    """[m]."""
    outline: Any
    """Shape in plan, a polygon of shapely or several [m]."""


@dataclass(frozen=True, eq=False)
class Space:
    """Room of a building: its name, use and storey, and where it is."""

    name: str
    floors: tuple[SpaceFloor, ...]
    """Floors from the lowest; a gallery lies above another one."""
    ceiling: float = np.inf
    """Height of its highest point [m]; infinite where it is not known."""
    use: str = ""
    """Use as the source names it, such as the program of a Honeybee room."""
    storey: str = ""
    volume: float | None = None
    """[m³]; None where it is not known."""
    target: float | None = None
    """Mean illuminance that its use wants [lx]; None where it is not known."""
    hours: tuple[int, int] | None = None
    """First hour of use on the clock, and the end of the last one [h]; None for all."""
    power: float | None = None
    """Installed power of its lamps [W/m²]; None where it is not known."""
    groups: tuple[str, ...] = ()
    """Groups of panes that close by the sun on its own sensors alone."""

    @property
    def floor_area(self) -> float:
        """Area of all floors in plan [m²]."""
        return float(sum(floor.outline.area for floor in self.floors))

    @property
    def height(self) -> float | None:
        """Height from the lowest floor to the highest point [m]; None where it is not known."""
        return self.ceiling - self.floors[0].height if np.isfinite(self.ceiling) else None

    @property
    def shape(self) -> tuple[Any, ...]:
        """Content of the space, for a digest."""
        floors = tuple((floor.height, floor.outline.wkb_hex) for floor in self.floors)
        return replace(self, floors=()), floors

    def scaled(self, factor: float) -> Space:
        """Multiply all lengths."""
        floors = tuple(
            SpaceFloor(z * factor, shapely.transform(outline, lambda xy: xy * factor))
            for z, outline in self.floors
        )
        volume = None if self.volume is None else self.volume * factor**3
        return replace(self, floors=floors, ceiling=self.ceiling * factor, volume=volume)


def floors_of(faces: Sequence[Rings], ceiling: float = np.inf) -> tuple[SpaceFloor, ...]:
    """Floors of polygons, those of one height together, from the lowest.

    Polygons without area are left out, and ledges less than `HEADROOM` below the ceiling [m].
    """
    levels: dict[float, list[Rings]] = {}
    for rings in faces:
        z = float(rings[0][:, 2].min())
        near = next((level for level in levels if abs(level - z) < LEVEL), z)
        levels.setdefault(near, []).append(rings)
    floors = (SpaceFloor(z, outline_of(levels[z])) for z in sorted(levels))
    whole = [floor for floor in floors if not floor.outline.is_empty]
    return tuple(floor for floor in whole if floor.height < ceiling - HEADROOM) or tuple(whole[:1])


def outline_of(faces: Sequence[Rings]) -> Any:
    """Union of polygons in plan, as shapely's geometry [m]; seams between them are closed."""
    shapes = [
        shapely.make_valid(shapely.Polygon(outline[:, :2], [hole[:, :2] for hole in holes]))
        for outline, *holes in faces
        if len(outline) > 2
    ]
    grown = [shape.buffer(SEAM / 2, join_style="mitre") for shape in shapes]
    return shapely.union_all(grown).buffer(-SEAM / 2, join_style="mitre")


def volume_of(faces: Sequence[Rings]) -> float:
    """Volume that polygons enclose [m³], counter-clockwise as seen from outside.

    By the divergence theorem, V = ⅓ Σ A · x with the area vector A of each polygon.
    """
    total = 0.0
    for outline, *holes in faces:
        area = area_vector(outline)
        lost = sum(float(np.linalg.norm(area_vector(hole))) for hole in holes)
        total += float(area @ outline[0]) * (1 - lost / max(float(np.linalg.norm(area)), 1e-12))
    return total / 3


def numbered(spaces: Sequence[Space]) -> tuple[Space, ...]:
    """Spaces whose names differ: equal ones get their storey, or a number, in brackets."""
    count = Counter(space.name for space in spaces)
    pairs = Counter((space.name, space.storey) for space in spaces)
    seen = Counter[tuple[str, str]]()
    out = []
    for space in spaces:
        own = space.name, space.storey
        if count[space.name] > 1:
            seen[own] += 1
            parts = [space.storey] if space.storey else []
            parts += [str(seen[own])] if pairs[own] > 1 else []
            space = replace(space, name=f"{space.name} ({', '.join(parts)})")
        out.append(space)
    return tuple(out)


def overlaps(
    spaces: Sequence[Space],
) -> Iterator[tuple[Space, Space, tuple[float, float]]]:
    """Yield spaces whose floors on one level overlap, with a point of the place (x, y) [m]."""
    floors = [(k, floor) for k, space in enumerate(spaces) for floor in space.floors]
    tree = shapely.STRtree([floor.outline for _, floor in floors])
    for i, (one, lower) in enumerate(floors):
        for j in sorted(tree.query(lower.outline, "intersects").tolist()):
            other, upper = floors[j]
            if j <= i or other == one or abs(lower.height - upper.height) > SAME_LEVEL:
                continue
            shared = lower.outline.intersection(upper.outline)
            if shared.area > OVERLAP * min(lower.outline.area, upper.outline.area):
                at = shared.representative_point()
                yield spaces[one], spaces[other], (float(at.x), float(at.y))


def overlap_notes(spaces: Sequence[Space]) -> tuple[str, ...]:
    """Note on the spaces that overlap; none where none do."""
    notes = Notes()
    for first, second, (x, y) in overlaps(spaces):
        notes.add(OVERLAPPING, f"{first.name} and {second.name} at ({x:.2f}, {y:.2f})")
    return notes.sentences()


def space_at(spaces: Sequence[Space], points: np.ndarray) -> np.ndarray:
    """Index of the space in which each point lies, −1 in none, int, shape (point,).

    Parameters
    ----------
    spaces : sequence of Space
    points : np.ndarray, shape (point, 3)
        Positions in the frame of the spaces [m]. Where outlines lie above each other, the highest
        floor below a point is its own.
    """
    out = np.full(len(points), -1)
    if not len(spaces) or not len(points):
        return out
    rows = [(k, s.ceiling, *floor) for k, s in enumerate(spaces) for floor in s.floors]
    number, ceiling, height = np.array([row[:3] for row in rows]).T
    outlines = np.array([row[3] for row in rows])
    at = shapely.points(points[:, :2])
    point, floor = shapely.STRtree(outlines).query(at, "dwithin", SEAM)
    z = points[point, 2]
    within = (z > height[floor] - SEAM) & (z < ceiling[floor] + SEAM)
    point, floor = point[within], floor[within]
    apart = shapely.distance(at[point], outlines[floor])
    order = np.lexsort((-apart, height[floor]))  # the last one stays: highest, nearest outline
    out[point[order]] = number[floor[order]]
    return out
