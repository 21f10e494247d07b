"""A year of glare against `evalglare` on full pictures of sixty hours.

Rationale: `drcmitsuba glare` makes no picture. Its illuminance comes from C, its luminances from
about 6,000 rays of an eye, which meet the patches of the sky. Pictures have the continuous sky, a
ray for each of 250,000 pixels, and sources that `evalglare` 3.06 joins pixel by pixel.

Method: an office with a clear window to the south, sixty hours of a typical year, three views:
towards the window, aslant, and away from it. `rendering.prepare` renders the pictures; `evalglare`
of pyradiance rates them. Both sides have independent random numbers.

Expected: DGP within 0.01 in nine of ten hours, 0.0075 in the mean, E_v within 4 % in the mean. The
rest are hours in which a part of the sky, or a sun patch, is near the threshold of 2000 cd/m² or of
the gap that joins sources, and hours in which the sun is in view: a pixel mixes the edge of its
disk with the sky, so that the disk is larger and dimmer in the picture.
"""

import re

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.picture import hdr
from drcmitsuba.picture.glare import glare
from drcmitsuba.rendering import prepare
from tests import radiance, skips
from tests.unit.glare_year.glare_room import case_in

pytestmark = [
    pytest.mark.slow,
    skips.RADIANCE.mark,
]
DAYS = ("01-14", "02-11", "03-11", "04-08", "05-06", "06-10", "07-08", "08-12", "09-09", "10-07",
        "11-11", "12-09")  # fmt: skip
TIMES = [f"{day}T{hour:02d}:30" for day in DAYS for hour in (8, 10, 12, 14, 16)]
SIZE = 400


def by_evalglare(rendering, folder):
    """DGP and vertical illuminance of a picture by `evalglare`."""
    hdr.save(rendering.picture, folder / "hour.hdr")
    text = radiance.run(["evalglare", "-d", "hour.hdr"], folder).decode()
    names, values = re.search(r"^(dgp,.*): (.*)$", text, re.MULTILINE).groups()
    found = dict(zip(names.split(","), map(float, values.split()), strict=True))
    return found["dgp"], found["E_v"]


def test_a_year_of_glare_is_that_of_evalglare_on_full_pictures(tmp_path):
    case = case_in(tmp_path, times=TIMES)
    case = case.with_tables(
        accuracy=case.accuracy.model_copy(update={"replicates": 8, "paths": 256})
    )
    hours = drcmitsuba.glare(case).hours.sel(state="open")
    rows = []
    for view in map(str, hours["view"].values):
        prepared = prepare(case, view, size=SIZE)
        for i, time in enumerate(TIMES):
            rendered = prepared.at(time.replace("T", " "))
            theirs, E = by_evalglare(rendered, tmp_path)
            ours = float(hours["dgp"].sel(view=view)[i])
            mine = float(hours["illuminance"].sel(view=view)[i])
            rows.append((view, time, ours, theirs, glare(rendered.picture).dgp(), mine, E))
            print("{:6s} {} DGP {:.3f} {:.3f} {:.3f} E {:.0f} {:.0f}".format(*rows[-1]), flush=True)
    ours, theirs, ours_E, E = (np.array([row[k] for row in rows]) for k in (2, 3, 5, 6))
    error, lit = np.abs(ours - np.minimum(theirs, 1)), E > 50
    print("DGP", error.mean(), np.quantile(error, 0.9), error.max())
    print("E", np.abs(ours_E[lit] / E[lit] - 1).mean(), np.abs(ours_E[lit] / E[lit] - 1).max())
    assert error.mean() <= 0.0075
    assert np.mean(error <= 0.01) >= 0.9
    assert np.abs(ours_E[lit] / E[lit] - 1).mean() <= 0.04
