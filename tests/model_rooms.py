"""Rooms of polygons, as a reader of models gives them."""

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.model.model import Layer, Model, role_of
from drcmitsuba.model.polygon import quads_of

GLASS = GlazingMaterial(type="glazing", transmittance=0.7, reflectance=0.08)


def layer(name, material, *polygons, holes=(), role=None):
    """Layer of polygons; the holes are those of the first polygon."""
    cut = [quads_of(np.array(p, float), holes if i == 0 else ()) for i, p in enumerate(polygons)]
    number = np.repeat(np.arange(len(cut)), [len(q) for q in cut])
    places = tuple(f"{name} {i}" for i in range(len(cut)))
    return Layer(name, material, role or role_of(material), np.concatenate(cut), number, places)


def case_of(*layers, north=0.0, **tables):
    """Case of a model, with the tables of a case file."""
    model = {"files": ["room.rad"], **tables.pop("model", {})}
    case = Case.model_validate({"model": model, **tables})
    for one in layers:
        if one.role == "pane":
            case.materials.setdefault(one.name, one.material)
    case._building = Model(tuple(layers), north=north)
    return case


def prism(outline, height):
    """Floor, ceiling and walls [m] of a room over an outline (corner, 2), fronts inward."""
    low = [(x, y, 0.0) for x, y in outline]
    high = [(x, y, height) for x, y in outline]
    n = len(outline)
    walls = [
        [low[(i + 1) % n], low[i], high[i], high[(i + 1) % n]] for i in range(n)
    ]  # fmt: skip
    return low, high[::-1], walls


def shell(width, depth, window, height=3.0):
    """Layers of floor, ceiling and walls of a room, with a window in its southern wall [m]."""
    floor, ceiling, walls = prism([(0, 0), (width, 0), (width, depth), (0, depth)], height)
    return (
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("facade", Lambertian(0.5), walls[0], holes=[window]),
        layer("walls", Lambertian(0.5), *walls[1:]),
    )


def l_room(**tables):
    """L-shaped room with a window to the south, a triangular one to the east, a sloped roof light.

    A hole in the ceiling under a pyramid's four glazed slopes lets the sky in; a post stands in
    the room, and a glazed partition cuts off the northern leg.
    """
    outline = [(0, 0), (6, 0), (6, 3), (3, 3), (3, 7), (0, 7)]
    floor, ceiling, walls = prism(outline, 3.0)
    south = np.array([[1, 0, 0.8], [5, 0, 0.8], [5, 0, 2.6], [1, 0, 2.6]], float)
    east = np.array([[6, 0.5, 0.8], [6, 2.5, 0.8], [6, 1.0, 2.7]], float)
    light = np.array([[0.8, 4.5, 3], [2.2, 4.5, 3], [2.2, 6.0, 3], [0.8, 6.0, 3]], float)
    top = np.array([1.5, 5.25, 3.8])
    slopes = [[light[i], light[(i + 1) % 4], top] for i in range(4)]
    partition = [[0, 3.5, 0], [3, 3.5, 0], [3, 3.5, 3], [0, 3.5, 3]]
    _, _, post = prism([(4, 1.5), (4.3, 1.5), (4.3, 1.8), (4, 1.8)], 3.0)
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.8), ceiling, holes=[light]),
        layer("south wall", Lambertian(0.6), walls[0], holes=[south]),
        layer("east wall", Lambertian(0.6), walls[1], holes=[east]),
        layer("walls", Lambertian(0.5), *walls[2:]),
        layer("post", Lambertian(0.4), *post),
        layer("glass", GLASS, south, east[::-1], *slopes, partition),
        **{"sensors": {"floors": ["floor"], "spacing": 1.5}, **tables},
    )


def house(*more, **tables):
    """Two rooms with southern windows below one with a sloped roof light over its northern half.

    The rooms are 4 m by 5 m each, the storeys 3 m high; one floor lies above the other.
    """
    outer = [(0, 0), (8, 0), (8, 5), (0, 5)]
    low, _, walls = prism(outer, 3.0)
    between = [[x, y, 3.0] for x, y in outer]
    wall = [[4, 0, 0], [4, 5, 0], [4, 5, 3], [4, 0, 3]]
    windows = [
        np.array([[x + 1, 0, 1], [x + 3, 0, 1], [x + 3, 0, 2.4], [x + 1, 0, 2.4]], float)
        for x in (0, 4)
    ]
    upper = [
        [[0, 0, 3], [0, 0, 5], [8, 0, 5], [8, 0, 3]],
        [[8, 0, 3], [8, 0, 5], [8, 5, 7], [8, 5, 3]],
        [[8, 5, 3], [8, 5, 7], [0, 5, 7], [0, 5, 3]],
        [[0, 5, 3], [0, 5, 7], [0, 0, 5], [0, 0, 3]],
    ]
    roof = [[0, 0, 5], [8, 0, 5], [8, 5, 7], [0, 5, 7]]
    light = np.array([[3, 2.5, 6], [5, 2.5, 6], [5, 4, 6.6], [3, 4, 6.6]], float)
    return case_of(
        layer("floor", Lambertian(0.3), low, between),
        layer("walls", Lambertian(0.6), walls[0], *walls[1:], wall, *upper, holes=windows),
        layer("roof", Lambertian(0.7), roof, holes=[light]),
        layer("glass", GLASS, *windows, light),
        *more,
        **{"sensors": {"floors": ["floor"], "spacing": 0.5}, **tables},
    )
