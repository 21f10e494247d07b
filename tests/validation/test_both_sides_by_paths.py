"""Rooms of a building that share faces, against path tracing of each room by itself.

Rationale: a wall between two rooms and a slab between two storeys are two faces in one place, each
with the reflectance of its room. A reader that gives both the same, or lets light through where
faces overlap in part, is wrong by some per cent in each room, and right in the sum.

Method: a corridor along three rooms of different reflectance, one of which is lower, and a room
above that overlaps all of them in part, in HBJSON. The path tracer has each room as a box of its
own, with a window in the middle third of one side, so that no reader of models takes part in it.

Expected: the light of sky and suns of every sensor within both errors (Šidák), and in sum.
"""

import json
from typing import NamedTuple

import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from tests.radiance import transmissivity
from tests.validation.calibration.comparison import by_paths
from tests.validation.calibration.rooms import Room

pytestmark = pytest.mark.slow
GLASS, INDEX = 0.65, 1.52
BOTTOM, TOP = 0.9, 2.1
"""Height of the windows above the floor [m]."""


class Box(NamedTuple):
    """A room: corner and size [m], reflectances [–], and the side of its window."""

    corner: tuple[float, float, float]
    size: tuple[float, float, float]
    floor: float
    wall: float
    ceiling: float
    side: str

    @property
    def sensors(self):
        """Points 0.8 m above the floor in the room's own coordinates [m], shape (sensor, 3)."""
        x, y, _ = self.size
        return np.array([[x * u, y * v, 0.8] for u in (0.2, 0.5, 0.8) for v in (0.3, 0.7)])


BOXES = {
    "corridor": Box((0, 0, 0), (9, 2, 3), 0.2, 0.5, 0.8, "west"),
    "white": Box((0, 2, 0), (3, 4, 3), 0.1, 0.9, 0.8, "north"),
    "dark": Box((3, 2, 0), (3, 4, 3), 0.4, 0.3, 0.6, "north"),
    "low": Box((6, 2, 0), (3, 4, 2.5), 0.3, 0.6, 0.9, "north"),
    "above": Box((1, 1, 3), (7, 5, 3), 0.6, 0.4, 0.7, "north"),
}
OUTWARD = {"south": (1, -1), "east": (0, 1), "north": (1, 1), "west": (0, -1)}
"""Axis and sign of the normal of every side."""


def wall(box, side, u=(0.0, 1.0), z=None):
    """Rectangle on a side of a box, from outside counter-clockwise, between two shares of it."""
    (axis, sign), corner, size = OUTWARD[side], np.array(box.corner, float), np.array(box.size)
    low, high = (0.0, size[2]) if z is None else z
    other = 1 - axis
    at = corner[axis] + (size[axis] if sign > 0 else 0)
    ends = [corner[other] + share * size[other] for share in u]
    if (axis == 0) != (sign > 0):  # seen from outside, left comes first
        ends.reverse()
    points = np.zeros((4, 3))
    points[:, axis] = at
    points[:, other] = [ends[0], ends[1], ends[1], ends[0]]
    points[:, 2] = corner[2] + np.array([low, low, high, high])
    return points.tolist()


def level(box, height):
    """Rectangle of the floor (0) or the ceiling, facing out of the box."""
    (x, y, z), (dx, dy, _) = box.corner, box.size
    ring = [[x, y, z + height], [x + dx, y, z + height],
            [x + dx, y + dy, z + height], [x, y + dy, z + height]]  # fmt: skip
    return ring if height else ring[::-1]


def face(name, kind, ring, rho, apertures=()):
    """Face of an HBJSON room."""
    modifier = {"type": "Plastic", "identifier": f"rho_{rho}"}
    modifier |= {f"{c}_reflectance": rho for c in "rgb"}
    return {
        "type": "Face", "identifier": name, "face_type": kind,
        "geometry": {"type": "Face3D", "boundary": ring},
        "boundary_condition": {"type": "Outdoors"},
        "properties": {"type": "FaceProperties", "radiance": {
            "type": "FaceRadianceProperties", "modifier": modifier}},
        "apertures": list(apertures),
    }  # fmt: skip


def room_of(name, box):
    """HBJSON room of a box."""
    clear = {
        "type": "Glass", "identifier": "glass",
        **{f"{c}_transmissivity": transmissivity(GLASS) for c in "rgb"},
    }  # fmt: skip
    ring = wall(box, box.side, (1 / 3, 2 / 3), (BOTTOM, TOP))
    pane = {
        "type": "Aperture", "identifier": f"{name}_window",
        "geometry": {"type": "Face3D", "boundary": ring},
        "boundary_condition": {"type": "Outdoors"},
        "properties": {"type": "AperturePropertiesAbridged", "radiance": {
            "type": "ApertureRadianceProperties", "modifier": clear}},
    }  # fmt: skip
    faces = [face(f"{name}_floor", "Floor", level(box, 0.0), box.floor)]
    faces += [face(f"{name}_ceiling", "RoofCeiling", level(box, box.size[2]), box.ceiling)]
    for side in OUTWARD:
        its = [pane] if side == box.side else []
        faces.append(face(f"{name}_{side}", "Wall", wall(box, side), box.wall, its))
    return {
        "type": "Room", "identifier": name, "faces": faces,
        "properties": {"type": "RoomProperties", "radiance": {"type": "RoomRadianceProperties"}},
    }  # fmt: skip


def building(folder):
    """Case of the building, with the sensors of every room."""
    grids = [
        {"type": "SensorGrid", "identifier": name, "sensors": [
            {"type": "Sensor", "pos": (p + box.corner).tolist(), "dir": [0, 0, 1]}
            for p in box.sensors]}
        for name, box in BOXES.items()
    ]  # fmt: skip
    model = {
        "type": "Model", "identifier": "house", "units": "Meters", "tolerance": 0.001,
        "rooms": [room_of(name, box) for name, box in BOXES.items()],
        "properties": {"type": "ModelProperties", "radiance": {
            "type": "ModelRadianceProperties", "sensor_grids": grids}},
    }  # fmt: skip
    (folder / "house.hbjson").write_text(json.dumps(model))
    text = '[model]\nfiles = ["house.hbjson"]\n[sensors]\ngrids = ["*"]\n'
    (folder / "case.toml").write_text(text)
    return load_case(folder / "case.toml")


def alone(box):
    """Case of one room as a box."""
    strip = {"bottom": BOTTOM, "top": TOP, "material": "glass", "segments": [1]}
    return Case.model_validate({
        "room": {"size": box.size, "floor": box.floor, "walls": box.wall, "ceiling": box.ceiling},
        "materials": {"glass": {"type": "glazing", "transmittance": GLASS, "ior": INDEX}},
        "facade": {box.side: {"segments": 3, "strips": [strip]}},
        "sensors": {"points": box.sensors.tolist()},
    })  # fmt: skip


def suns_of():
    """Eight suns, two of which shine into each side with a window."""
    azimuth, height = np.radians([250, 280, 300, 330, 0, 20, 45, 60]), np.radians(25)
    directions = np.stack([np.sin(azimuth) * np.cos(height), np.cos(azimuth) * np.cos(height),
                           np.full(8, np.sin(height))], axis=1)  # fmt: skip
    return Suns(tuple(f"sun_{i}" for i in range(8)), directions, 2.0)


def test_each_room_has_its_own_side(same, tmp_path):
    backend.select()
    case, suns = building(tmp_path), suns_of()
    fine = {"paths": 1024, "cell_size": 0.3, "sensor_sky_rays": 4096, "replicates": 16}
    case = case.with_tables(accuracy=case.accuracy.model_copy(update=fine))
    effects = EnabledEffects(solved_cells=True, pane_to_pane=False)
    C = simulation.transport(case, "open", suns, 46.0, run=Run.of(case, effects))
    ours, grids = C["replicates"].values, prepared(case).receivers.coordinates["grid"].values
    theirs = {}
    for name, box in BOXES.items():
        one = alone(box)
        points, normals = sensor_points(one)
        theirs[name] = by_paths(Room(one), suns, points, normals, 8192).sum(axis=1)[:, 0]
    for name, other in theirs.items():
        mine = ours[:, grids == name]
        for bins in (slice(1, 146), slice(146, None)):
            same(mine[..., bins].sum(axis=-1), other=other[..., bins].sum(axis=-1), within=0.015)
