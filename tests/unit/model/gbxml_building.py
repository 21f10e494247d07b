"""A small building in gbXML, written out: two rooms below a third one, in any unit."""

from pathlib import Path

import numpy as np

NAMESPACE = "http://www.gbxml.org/schema"
FOOT = 0.3048


def loop(corners, scale=1.0):
    """PlanarGeometry of corners (corner, 3) [m]."""
    points = "".join(
        "<CartesianPoint>"
        + "".join(f"<Coordinate>{v * scale:.9f}</Coordinate>" for v in corner)
        + "</CartesianPoint>"
        for corner in corners
    )
    return f"<PlanarGeometry><PolyLoop>{points}</PolyLoop></PlanarGeometry>"


def surface(name, kind, corners, spaces=(), openings="", scale=1.0):
    """Surface that faces out of the first of its spaces."""
    beside = "".join(f'<AdjacentSpaceId spaceIdRef="{s}"/>' for s in spaces)
    planar = loop(corners, scale)
    return f'<Surface id="{name}" surfaceType="{kind}">{beside}{planar}{openings}</Surface>'


def opening(name, corners, kind="FixedWindow", glass='windowTypeIdRef="g"', scale=1.0):
    """Opening of a surface."""
    return f'<Opening id="{name}" openingType="{kind}" {glass}>{loop(corners, scale)}</Opening>'


def space(name, shown, storey="s1", kind="OfficeOpenPlan", more=""):
    """Space of the building."""
    return (
        f'<Space id="{name}" buildingStoreyIdRef="{storey}" spaceType="{kind}">'
        f"<Name>{shown}</Name>{more}</Space>"
    )


def rect(axis, at, low, high):
    """Rectangle across an axis, between two corners of the other axes, counter-clockwise to +."""
    u, v = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.zeros((4, 3))
    out[:, axis] = at
    out[:, u] = [low[0], high[0], high[0], low[0]]
    out[:, v] = [low[1], low[1], high[1], high[1]]
    return out


WINDOW = rect(1, 0.0, (1.0, 1.0), (2.0, 3.0))
"""z from 1 to 2 m, x from 1 to 3 m, facing north."""


def surfaces(scale=1.0, without=()):
    """Surfaces of the building by name.

    Rooms a and b are 4 m by 5 m each and 3 m high, c lies above both.
    """
    to_south, to_north = (lambda r: r[::-1]), (lambda r: r)
    made = {}

    def add(name, kind, corners, spaces, openings=""):
        made[name] = surface(name, kind, corners, spaces, openings, scale)

    glass = opening("w1", WINDOW[::-1], scale=scale)
    for room, x in (("a", 0.0), ("b", 4.0)):
        add(f"floor {room}", "SlabOnGrade", rect(2, 0, (x, 0), (x + 4, 5))[::-1], [room])
        add(f"slab {room}", "InteriorFloor", rect(2, 3, (x, 0), (x + 4, 5)), [room, "c"])
        south = to_south(rect(1, 0, (0, x), (3, x + 4)))
        add(f"south {room}", "ExteriorWall", south, [room], glass if room == "a" else "")
        add(f"north {room}", "ExteriorWall", to_north(rect(1, 5, (0, x), (3, x + 4))), [room])
    add("west a", "ExteriorWall", rect(0, 0, (0, 0), (5, 3))[::-1], ["a"])
    add("between", "InteriorWall", rect(0, 4, (0, 0), (5, 3)), ["a", "b"])
    add("east b", "ExteriorWall", rect(0, 8, (0, 0), (5, 3)), ["b"])
    add("roof", "Roof", rect(2, 6, (0, 0), (8, 5)), ["c"])
    add("south c", "ExteriorWall", to_south(rect(1, 0, (3, 0), (6, 8))), ["c"])
    add("north c", "ExteriorWall", rect(1, 5, (3, 0), (6, 8)), ["c"])
    add("west c", "ExteriorWall", rect(0, 0, (0, 3), (5, 6))[::-1], ["c"])
    add("east c", "ExteriorWall", rect(0, 8, (0, 3), (5, 6)), ["c"])
    add("tree", "Shade", rect(1, -10, (0, 0), (5, 5)), [])
    return {name: text for name, text in made.items() if name not in without}


def with_window_above():
    """Surfaces of the building with a window of the room below and one of that above, 2 m² each."""
    parts = surfaces()
    above = opening("w2", WINDOW[::-1] + [2, 0, 3])
    parts["south c"] = surface(
        "south c", "ExteriorWall", rect(1, 0, (3, 0), (6, 8))[::-1], ["c"], above
    )
    return parts


def text(parts, spaces=None, unit="Meters", head="", types=None, place=""):
    """Text of a file."""
    spaces = spaces or [
        space("a", "Office"), space("b", "Office"), space("c", "大厅", "s2", "Lobby"),
    ]  # fmt: skip
    types = types or (
        '<WindowType id="g"><Name>Double</Name>'
        '<Transmittance type="Visible" unit="Fraction">0.7</Transmittance></WindowType>'
    )
    storeys = "".join(
        f'<BuildingStorey id="{s}"><Name>Level {s[1]}</Name></BuildingStorey>' for s in ("s1", "s2")
    )
    inner = f"<Building id='h'>{''.join(spaces)}{storeys}</Building>{''.join(parts)}"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{head}<gbXML xmlns="{NAMESPACE}" '
        f'lengthUnit="{unit}" volumeUnit="CubicFeet">'
        f"<Campus id='site'>{place}{inner}</Campus>{types}</gbXML>"
    )


def written(folder: Path, content: str) -> Path:
    """Write a file of the building."""
    file = folder / "house.xml"
    file.write_text(content, encoding="utf-8")
    return file
