"""Pictures against those that were looked at and kept, reduced so that letters may differ a little.

    python -m tests.unit.report.test_compared_pictures

draws the kept ones again, after a change that is meant; look at each before it is committed. The
data are made by hand, so that a picture changes only where its drawing does.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.image import imread, imsave

from drcmitsuba.picture import tone
from drcmitsuba.picture.false_colour import false_colour
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.view import PictureView
from drcmitsuba.report import glare_plots, plots
from tests import skips
from tests.unit.report.test_plots import grid, year
from tests.unit.report.test_year_figures import GENEVA, weekdays

KEPT = Path(__file__).with_name("pictures")
COLUMNS = 160
"""Columns of a kept picture."""
TOLERANCE = 3.0
"""Largest RMS difference of two reduced pictures [of 255]. Another font moves some letters by a
pixel; contours that are missing make a difference of 5, other colours one of 40."""


def of_the_year():
    values = weekdays()
    day, hour = (values["time"].dt.dayofyear - 172) / 183, (values["time"].dt.hour - 12.5) / 6
    return values.copy(data=2000 * np.exp(-2 * day**2 - hour**2))


def fisheye():
    view = PictureView("equidistant", (0, 1, 0), (0, 0, 1), (180, 180))
    luminance = np.full((120, 120, 3), 60, np.float32)
    luminance[20:60, 30:90] = 4000
    luminance[70:90, 40:50] = 700
    seen = np.isfinite(view.pixel_directions(120, 120)).all(axis=-1)
    return Picture(luminance * seen[..., None], view)


def directions():
    angle = np.linspace(0, np.pi, 9)
    suns = np.stack([np.cos(angle), -0.8 * np.sin(angle), 0.7 * np.sin(angle) + 0.05], axis=1)
    d = np.concatenate([[[0, 0, -1.0]], np.tile([0, 0, 1.0], (145, 1)), suns])
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def dome():
    values = np.r_[0.01, np.linspace(0, 0.05, 145), np.linspace(0.01, 0.06, 9)]
    attrs = {"long_name": "coefficient", "units": "sr"}
    at = xr.DataArray(directions(), dims=("bin", "axis"))
    return plots.sky_dome(xr.DataArray(values, dims="bin", attrs=attrs), at, title="dome").figure


def glare_plan():
    points = np.array([[1, 1], [1, 1], [3, 2]], float)
    towards = np.array([[0, -1], [1, 0], [-1, 0]], float)
    return glare_plots.plan(points, towards, np.array([1.0, 12.0, 40.0]), title="glare")


FIGURES = {
    "plan": lambda: plots.plan(grid(6, 8), contours=(500, 1000), title="plan"),
    "mountain": lambda: plots.mountain(grid(6, 8), title="mountain").figure,
    "section": lambda: (
        plots.section(
            grid(6, 8), grid(6, 8) / 20, start=(1.25, 0), end=(1.25, 4), title="section"
        ).figure
    ),
    "temporal_map": lambda: plots.temporal_map(of_the_year(), title="year").figure,
    "sun_path": lambda: plots.sun_path(of_the_year() > 900, GENEVA, title="suns").figure,
    "sky_dome": dome,
    "monthly": lambda: plots.monthly(year()),
    "glare_year": lambda: glare_plots.year(of_the_year() / 3000, title="glare"),
    "glare_plan": glare_plan,
    "false_colour": lambda: false_colour(fisheye(), least=10, most=10_000, title="view"),
    "human": lambda: tone.human(fisheye()),
    "exposed": lambda: tone.exposed(fisheye(), white=4000),
}


def reduced(drawn):
    """Pixels of a figure or a picture as means over squares, float from 0 to 255."""
    if hasattr(drawn, "savefig"):
        drawn.set_dpi(100)
        canvas = FigureCanvasAgg(drawn)
        canvas.draw()
        drawn = np.asarray(canvas.buffer_rgba())
    pixels = np.asarray(drawn)[..., :3].astype(float)
    step = max(1, pixels.shape[1] // COLUMNS)
    rows, columns = (n // step for n in pixels.shape[:2])
    pixels = pixels[: rows * step, : columns * step]
    return pixels.reshape(rows, step, columns, step, 3).mean(axis=(1, 3))


def difference(one, two):
    assert one.shape == two.shape
    return np.sqrt(((one - two) ** 2).mean())


@skips.PICTURES.mark
@pytest.mark.parametrize("name", FIGURES)
def test_a_picture_is_the_one_that_was_looked_at(name):
    kept = 255 * imread(KEPT / f"{name}.png")[..., :3]
    assert difference(reduced(FIGURES[name]()), kept) < TOLERANCE


@pytest.mark.parametrize(
    "other",
    [
        lambda: plots.plan(grid(6, 8).copy(data=grid(6, 8).values[::-1]), title="plan"),
        lambda: plots.plan(grid(6, 8), norm=Normalize(0, 2000), contours=(500, 1000), title="plan"),
        lambda: plots.plan(grid(6, 8), title="plan"),
    ],
)
def test_another_picture_is_seen_to_be_another(other):
    kept = 255 * imread(KEPT / "plan.png")[..., :3]
    drawn = reduced(other())
    assert drawn.shape != kept.shape or difference(drawn, kept) > TOLERANCE


if __name__ == "__main__":
    for name, draw in FIGURES.items():
        imsave(KEPT / f"{name}.png", reduced(draw()).round().astype(np.uint8))
