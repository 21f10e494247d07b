"""Mirrored suns at sensors hour by hour, against the virtual light sources of Radiance's `mirror`.

A wall with a window, and opposite a mirror of 3 × 4 m: `rtrace -ab 0` follows sun and image.
"""

import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.rays.shadow_rays import sun_deposit
from tests import radiance, skips

pytestmark = skips.RADIANCE.mark

RHO, DIAMETER = 0.6, 0.53
EAST, NORTH, UP = np.eye(3)
OPPOSITE = quad([-1.5, 8, 0], 4 * UP, 3 * EAST)
WALL = [
    quad([-6, 2, 0], 1.0 * UP, 12 * EAST),
    quad([-6, 2, 2.5], 2.5 * UP, 12 * EAST),
    quad([-6, 2, 1.0], 1.5 * UP, 5 * EAST),
    quad([1, 2, 1.0], 1.5 * UP, 5 * EAST),
]
POINTS = np.array([[x, y, z] for x in (-0.7, 0.4) for y in (0.3, 1.4) for z in (0.9, 1.6)])
NORMALS = np.array([NORTH, UP, NORTH, UP, NORTH, UP, NORTH, NORTH])


def suns():
    """Suns from the south, east to west, that the mirror may throw on a window to the north."""
    azimuth, altitude = np.meshgrid(np.radians(np.arange(150, 211, 6)), np.radians([5, 14, 24, 38]))
    d = [np.cos(altitude) * np.sin(azimuth), np.cos(altitude) * np.cos(azimuth), np.sin(altitude)]
    return np.stack(d, axis=-1).reshape(-1, 3)


def polygon(material, name, corners):
    numbers = " ".join(f"{x:.9g}" for x in corners.ravel())
    return f"{material} polygon {name} 0 0 12 {numbers}\n"


def test_mirrored_suns_are_those_of_rtrace(tmp_path):
    backend.select()
    opposite = MirrorMaterial(type="mirror", reflectance=RHO)
    scene = build(
        [
            Surface("mirror", opposite, OPPOSITE[None], "mirror"),
            Surface("wall", Lambertian(0.0), np.array(WALL)),
        ]
    )
    light = {"suns": suns(), "diameter": DIAMETER, "samples": 2, "seed": 0}
    again = 256
    p, n = (flat(np.repeat(x, again, axis=0)) for x in (POINTS, NORMALS))
    D = ImageSuns.of(scene).suns(p, n, **light).numpy() + sun_deposit(scene, p, n, **light).numpy()
    ours = D.reshape(len(POINTS), again, -1).mean(axis=1)

    solid = f"void mirror m 0 0 3 {RHO} {RHO} {RHO}\nvoid plastic black 0 0 5 0 0 0 0 0\n"
    solid += polygon("m", "opposite", OPPOSITE[::-1])
    solid += "".join(polygon("black", f"wall{i}", q) for i, q in enumerate(WALL))
    lines = "\n".join(" ".join(map(str, row)) for row in np.hstack([POINTS, NORMALS])) + "\n"
    theirs = np.zeros_like(ours)
    for k, d in enumerate(light["suns"]):
        at = " ".join(map(str, d))
        sun = f"void light s 0 0 3 1 1 1\ns source sun 0 0 4 {at} {DIAMETER}\n"
        (tmp_path / "scene.rad").write_text(solid + sun)
        (tmp_path / "scene.oct").write_bytes(radiance.run(["oconv", "scene.rad"], tmp_path))
        options = [
            "-h",
            "-I",
            "-ab",
            "0",
            "-dj",
            "1",
            "-ds",
            "0.01",
            "-dt",
            "0",
            "-dc",
            "1",
            "-dr",
            "1",
        ]
        told = radiance.run(
            ["rtrace", *options, "scene.oct"], tmp_path, (lines * 64).encode(), 60
        ).decode()
        numbers = np.array([row.split()[1] for row in told.splitlines()], float)
        theirs[:, k] = numbers.reshape(64, -1).mean(axis=0)
    full = theirs.max()
    lit = theirs > 1e-3 * full
    assert 20 < lit.sum() < lit.size
    edge = 0.15 * full  # disks that an edge cuts: both estimate the visible part at random
    assert (abs(ours - theirs) < edge).all()
    whole = abs(ours - theirs) < 0.01 * full
    assert whole.mean() > 0.9
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.01)
