"""Rooms of a dozen kinds, with their suns and the places of eyes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import BsdfMaterial, GlazingMaterial, Lambertian, MirrorMaterial
from drcmitsuba.sky.sun_models import Suns
from tests import ROOT
from tests.model_rooms import case_of, l_room, layer, shell

NARROW, WIDE = 0.533, 10.0
"""Angles across a sun [deg]."""
GLASS = {"glass": {"type": "glazing", "transmittance": 0.65}}
STRIP = {"bottom": 0.9, "top": 2.7, "material": "glass"}
ABOVE_GLASS = [STRIP | {"top": 1.8}, {"bottom": 1.8, "top": 2.7, "material": "film"}]
PRISM = ROOT / "scenes" / "films" / "prism.xml"
SILVER = MirrorMaterial(type="mirror", reflectance=0.6)
PANEL = ROOT / "scenes" / "prism" / "panel.xml"


@dataclass(frozen=True)
class Room:
    """A room, and what is asked of it."""

    case: Case
    diameter: float = NARROW
    """Angle across the suns [deg]."""
    paths: int = 2048
    """Number of paths from a sensor in each run of the path tracer."""
    pane_to_pane: bool = False
    """Whether photons follow light from pane to pane, which rooms of one window have none of."""
    images: tuple[Case, str] | None = None
    """Case in which images of the suns shine through a mirror to the north or south, and the
    mirror's name: plain paths find suns in mirrors by chance alone."""
    eye: tuple[float, float, float] = (0.55, 0.4, 0.4)
    """Place of the eyes, as shares of the room's size."""
    size: tuple[float, float, float] | None = None
    """Width, depth and height [m]; None for that of the case."""

    @property
    def suns(self) -> Suns:
        """Thirty suns."""
        directions = suns()
        return Suns(tuple(f"sun_{i}" for i in range(len(directions))), directions, self.diameter)

    @property
    def places(self) -> np.ndarray:
        """Place of the eyes in the coordinates of the case [m], shape (1, 3)."""
        room = self.case.room
        size = self.size or (None if room is None else room.size)
        assert size is not None
        return np.array([self.eye]) * np.array(size)


def suns() -> np.ndarray:
    """Ten suns each of an equinox and both solstices at 46° north, around noon, shape (30, 3)."""
    latitude, out = math.radians(46.2), []
    for declination, longest in ((0.0, 60.0), (23.4, 45.0), (-23.4, 45.0)):
        d, hour = math.radians(declination), np.radians(np.linspace(-longest, longest, 10))
        east = -math.cos(d) * np.sin(hour)
        north = math.cos(latitude) * math.sin(d) - math.sin(latitude) * math.cos(d) * np.cos(hour)
        up = math.sin(latitude) * math.sin(d) + math.cos(latitude) * math.cos(d) * np.cos(hour)
        out.append(np.stack([east, north, up], axis=1))
    return np.concatenate(out)


def box(size, sensors, strips=(STRIP,), furniture=(), materials=None, components=None, **room):
    """Case of a room with a façade to the south; sensors are its height and its spacing [m]."""
    height, spacing = sensors
    count = [int((length - 0.4) // spacing) for length in size[:2]]
    surfaces = {"size": size, "floor": 0.2, "ceiling": 0.8, "walls": 0.5} | room
    return Case.model_validate(
        {
            "room": surfaces,
            "facade": {"south": {"strips": list(strips)}},
            "materials": GLASS | (materials or {}),
            "components": components or {},
            "furniture": list(furniture),
            "sensors": {"corner": [0.2, 0.2, height], "count": count, "spacing": spacing},
        }
    )


def many(corner, size, count, step, reflectance=0.4):
    """Table of equal bodies."""
    return {
        "corner": corner, "size": size, "count": count, "step": step, "reflectance": reflectance,
    }  # fmt: skip


def furnished() -> Case:
    """Desks with screens and side panels, sensors below the tops."""
    return box(
        [8.0, 8.0, 3.0],
        (0.35, 0.6),
        furniture=[
            many([0.6, 0.7, 0.72], [1.4, 0.7, 0.02], [4, 5], [1.9, 1.45], 0.5),
            many([0.6, 1.42, 0.0], [1.4, 0.04, 1.3], [4, 5], [1.9, 1.45]),
            many([2.02, 0.7, 0.0], [0.04, 0.7, 0.72], [4, 5], [1.9, 1.45]),
        ],
    )


def slats() -> Case:
    """Level slats behind the window, as geometry."""
    slat = many([0.3, 0.08, 1.0], [4.4, 0.08, 0.005], [1, 1], [5.0, 1.0])
    return box(
        [5.0, 6.0, 3.0],
        (0.8, 0.6),
        furniture=[slat | {"corner": [0.3, 0.08, 1.0 + 0.12 * i]} for i in range(14)],
    )


def film(file, strips=ABOVE_GLASS) -> Case:
    """Room with a measured film or panel in its façade."""
    material = {"film": {"type": "bsdf", "file": str(file)}}
    return box([5.0, 6.0, 3.0], (0.8, 0.7), strips=strips, materials=material)


def lamellae() -> Case:
    """Curved mirror lamellae above clear glass."""
    strips = [STRIP | {"top": 1.8}, {"bottom": 1.8, "top": 2.7, "material": "lamellae"}]
    recipe = ROOT / "scenes" / "lamella" / "recipe.toml"
    component = {"type": "structure", "recipe": str(recipe), "outer": "glass"}
    return box(
        [5.0, 6.0, 3.0], (0.8, 0.9), strips=strips, components={"lamellae": component}
    )  # fmt: skip


def mirror_opposite(images: bool = False) -> Case:
    """Window to the north, and 10 m before it a mirror that sees the sun above the roof.

    With `images`, black walls lead from its edges to the facade, and behind it stands the room's
    image: suns in mirrored directions light the room through it as the suns do by the mirror. No
    wall is further away than that: rays of Mitsuba start a distance from surfaces that grows with
    the coordinates, 2 cm in a scene of 200 m, in which the room was 1.6 % brighter.
    """
    window = np.array([[0.5, 0, 0.9], [4.5, 0, 0.9], [4.5, 0, 2.6], [0.5, 0, 2.6]])
    x, z = np.array([[-8, 13], [0, 24]])

    def upright(left: float, right: float, bottom: float, top: float, y: float) -> list:
        return [(left, y, bottom), (left, y, top), (right, y, top), (right, y, bottom)]

    opposite = [layer("mirror", SILVER, upright(*x, *z, -10))]
    if images:
        aside = [[(at, -10, z[0]), (at, -10, z[1]), (at, 0, z[1]), (at, 0, z[0])] for at in x]
        above = [(x[0], -10, z[1]), (x[1], -10, z[1]), (x[1], 0, z[1]), (x[0], 0, z[1])]
        roof = [(0, -26, 3), (5, -26, 3), (5, -20, 3), (0, -20, 3)]
        dark = [*aside, above, upright(0, 5, 0, 3, -20), roof]
        opposite.append(layer("screen", Lambertian(0.0), *dark))
    return case_of(
        *shell(5, 6, window),
        layer("glass", GlazingMaterial(type="glazing", transmittance=0.7), window),
        *opposite,
        sensors={"floors": ["floor"], "spacing": 0.8, "margin": 0.5},
        model={"files": [__file__]},
        north=180.0,
    )


def roof_light() -> Case:
    """L-shaped room with windows on two sides, a roof light and a glazed partition."""
    sensors = {"floors": ["floor"], "height": 0.8, "spacing": 0.6}
    return l_room(sensors=sensors, model={"files": [__file__]})


def film_behind_glass() -> Case:
    """Measured film 0.1 m behind clear glass that is larger than it, in a model."""

    def upright(y: float, rim: float) -> np.ndarray:
        left, right, bottom, top = 0.5 - rim, 4.5 + rim, 0.9 - rim, 2.6 + rim
        return np.array([[left, y, bottom], [right, y, bottom], [right, y, top], [left, y, top]])

    window = upright(0.0, 0.0)
    return case_of(
        *shell(5, 6, window),
        layer("glass", GlazingMaterial(type="glazing", transmittance=0.7), upright(-0.1, 0.3)),
        layer("film", BsdfMaterial(type="bsdf", file=str(PRISM)), window),
        sensors={"floors": ["floor"], "spacing": 0.8, "margin": 0.5},
        model={"files": [__file__], "leaks": "allow"},  # beside the glass
    )


COLOURS = {"floor": [0.30, 0.18, 0.08], "walls": [0.7, 0.5, 0.3], "ceiling": [0.85, 0.85, 0.8]}
TALL = {"bottom": 0.5, "top": 8.5, "material": "glass"}
SHELVES = many([1.0, 1.2, 0.0], [6.0, 0.35, 2.0], [1, 5], [7.0, 1.3])
ROOMS: dict[str, Callable[[], Room]] = {
    "empty": lambda: Room(box([8.0, 8.0, 3.0], (0.8, 0.7))),
    "furnished": lambda: Room(furnished(), eye=(0.31, 0.39, 0.42)),
    "shelves": lambda: Room(
        box([8.0, 8.0, 3.0], (0.8, 0.6), furniture=[SHELVES]),
        eye=(0.5, 0.42, 0.4),
    ),
    "corridor": lambda: Room(box([2.0, 16.0, 3.0], (0.8, 0.5))),
    "atrium": lambda: Room(box([10.0, 10.0, 9.0], (0.8, 0.9), strips=[TALL])),
    "deep": lambda: Room(box([5.0, 14.0, 3.0], (0.8, 0.7))),
    "white": lambda: Room(box([5.0, 6.0, 2.8], (0.8, 0.6), floor=0.8, walls=0.9, ceiling=0.9)),
    "slats": lambda: Room(slats()),
    "roof light and partition": lambda: Room(
        roof_light(), WIDE, 1 << 12, pane_to_pane=True, size=(3.0, 7.0, 3.0), eye=(0.5, 0.7, 0.4)
    ),
    "film": lambda: Room(film(PRISM)),
    "panel": lambda: Room(film(PANEL)),
    "film behind glass": lambda: Room(
        film_behind_glass(), paths=1 << 13, pane_to_pane=True, size=(5.0, 6.0, 3.0)
    ),
    "lamellae": lambda: Room(lamellae(), WIDE, 1 << 13),
    "mirror opposite": lambda: Room(
        mirror_opposite(),
        paths=1 << 13,
        images=(mirror_opposite(True), "mirror"),
        size=(5.0, 6.0, 3.0),
    ),
    "coloured": lambda: Room(box([5.0, 6.0, 3.0], (0.8, 0.6), **COLOURS)),
}
"""Rooms by their kind."""
