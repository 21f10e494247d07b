"""The sun's disk as a source of a year of glare against `evalglare` on ever finer pictures.

Rationale: a year of glare counts the disk with its own luminance and solid angle. A picture of 400
by 400 pixels has pixels as wide as the disk: those at its edge mix it with the sky, so that the
source is larger and dimmer, and Σ L² ω smaller by the ratio of the solid angles.

Method: an even sky, a disk of a hazy sun 25° beside the line of sight, 64 directions in each pixel.
`evalglare` rates pictures of 400 to 1600 columns. The exact DGP follows from the disk by itself.

Expected: where n pixels of the solid angle ω_p are brighter than 50 000 cd/m², the picture's DGP is
lower by 0.092 log10(n ω_p / ω) than with the disk of the solid angle ω. Finer pictures come to it.
"""

import re

import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.picture import hdr
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.picture.view import PictureView
from tests import radiance, skips

pytestmark = [
    pytest.mark.slow,
    skips.RADIANCE.mark,
]
SKY, SUN, DIAMETER, FINER = 1500.0, 3e6, 0.533, 8
VIEW = PictureView("equidistant", (0, 1, 0), (0, 0, 1), angles=(180, 180))
TOWARDS = np.array([np.sin(np.radians(25)) * 0.8, np.cos(np.radians(25)),
                    np.sin(np.radians(25)) * 0.6])  # fmt: skip


def picture_of(size):
    """Even sky with the disk, each pixel the mean of its directions, and its peak pixels."""
    inside = np.isfinite(VIEW.pixel_directions(size, size)).all(axis=-1)
    L = np.where(inside, SKY, 0)
    right, up, forward = VIEW.frame @ TOWARDS
    radius = np.degrees(np.arccos(forward)) / 90 * size / 2
    column = size / 2 + radius * right / np.hypot(right, up)
    row = size / 2 - radius * up / np.hypot(right, up)
    near = int(np.ceil(DIAMETER / 180 * size)) + 2
    rows, columns = (slice(int(at) - near, int(at) + near + 1) for at in (row, column))
    i, j = (np.arange(some.start * FINER, some.stop * FINER) for some in (rows, columns))
    y, x = 1 - 2 * (i[:, None] + 0.5) / (size * FINER), 2 * (j + 0.5) / (size * FINER) - 1
    r = np.hypot(x, y)
    sine = np.sin(np.pi / 2 * r) / r
    d = np.stack([sine * x, sine * y, np.cos(np.pi / 2 * r)], axis=-1) @ VIEW.frame
    hit = np.linalg.norm(d - TOWARDS, axis=-1) < 2 * np.sin(np.radians(DIAMETER) / 4)
    share = hit.reshape(2 * near + 1, FINER, 2 * near + 1, FINER).mean(axis=(1, 3))
    L[rows, columns] += (SUN - SKY) * share
    picture = Picture(np.repeat(L[..., None], 3, axis=2).astype(np.float32), VIEW)
    return picture, int((L > 50_000).sum())


def by_evalglare(picture, folder):
    """DGP of a picture by `evalglare`."""
    hdr.save(picture, folder / "sun.hdr")
    text = radiance.run(["evalglare", "-d", "sun.hdr"], folder).decode()
    names, values = re.search(r"^(dgp,.*): (.*)$", text, re.MULTILINE).groups()
    return dict(zip(names.split(","), map(float, values.split()), strict=True))["dgp"]


def test_finer_pictures_come_to_the_exact_disk(tmp_path):
    omega = disk_solid_angle(DIAMETER)
    local = VIEW.frame @ TOWARDS
    Ev = np.pi * SKY + (SUN - SKY) * omega * local[2]
    exact = float(Rule().dgp(Ev, SUN**2 * omega / position_index(local) ** 2))
    angle, lower, expected = np.arccos(local[2]), [], []
    for size in (400, 800, 1600):
        picture, peaks = picture_of(size)
        of_pixel = (np.pi / size) ** 2 * np.sin(angle) / angle
        lower.append(exact - by_evalglare(picture, tmp_path))
        expected.append(0.092 * np.log10(peaks * of_pixel / omega))
    print("exact", exact, "lower by", lower, "expected", expected)
    np.testing.assert_allclose(lower, expected, atol=0.003)
    assert lower[0] > 0.03
    assert (np.diff(lower) < 0).all()
    assert abs(2 * lower[2] - lower[1]) < 0.004  # pixels of no size
