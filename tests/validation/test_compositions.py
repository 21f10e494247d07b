"""Compositions recombined from light by tile against simulations of their own."""

import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches
from scipy.stats import t as student

from drcmitsuba import load_case
from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Strip
from drcmitsuba.design.facade_tiles import TiledLight
from drcmitsuba.runtime import backend
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.facade_rectangles import fill_at
from drcmitsuba.scene.tiled_facades import TiledFacades
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import elements

HEIGHTS = [0.9, 1.8, 2.7, 3.6]
SEGMENTS = 6
MATERIALS = ["wall", "glass", "film", "shade"]
STAMPS = 48


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def mixed(case, rng, number):
    """A façade whose 18 tiles are of random materials; the shade may stand in a tile as well."""
    chosen = rng.choice(MATERIALS, (3, SEGMENTS), p=rng.dirichlet(np.ones(4)))
    strips = [
        Strip(bottom=HEIGHTS[i], top=HEIGHTS[i + 1], material=str(chosen[i, j]), segments=(j,))
        for i in range(3)
        for j in range(SEGMENTS)
    ]
    south = case.facade["south"].model_copy(update={"strips": tuple(strips), "frame": 0.0})
    return case.model_copy(update={"name": f"mixed {number}", "facade": {"south": south}})


def some_hours(light):
    """Weights [cd/m²] of all bins: their mean luminance over hours spread over the year."""
    up = np.flatnonzero(light.sky["sun_bin"].values != "")
    hours = up[np.linspace(0, len(up) - 1, STAMPS).astype(int)]
    at = light.sky.isel(time=hours)
    suns = light.suns.only(at["sun_bin"].values.astype(object))
    by_sun = dict(zip(map(str, at["sun_bin"].values), at["sun"].values / STAMPS, strict=True))
    L = [*at["sky"].values.mean(axis=0), *(by_sun[label] for label in suns.labels)]
    return suns, np.array(L)


def spread(replicates):
    return replicates.mean(axis=0), replicates.std(axis=0, ddof=1) / np.sqrt(len(replicates))


@pytest.mark.slow
@pytest.mark.parametrize("state", ["open", "shaded"])
def test_fifty_mixed_compositions(state, capsys):
    """Mean E of the year, in all and by sensor, within errors (Šidák) or 0.3 % of the mean."""
    # Glass that mirrors, a shade that reflects, the measured film: not only Lambertian walls.
    case, rng = load_case("classroom/o3"), np.random.default_rng(5)
    light = daylight(case)
    suns, L = some_hours(light)
    cases = [mixed(case, rng, i) for i in range(50)]  # ten together scatter by 0.2 %
    finer = case.accuracy.model_copy(update={"replicates": 24})  # all compositions share its noise

    cut = TiledFacades.of_grid(case, "south", np.array(HEIGHTS), SEGMENTS, tuple(MATERIALS))
    lit = elements.compute(cut.case, cut.panes, suns, finer, ALL_EFFECTS)
    tiled = TiledLight.of(cut, 3 * SEGMENTS, (lit,))
    left, right, bottom, top = tiled.tiles.bounds.T
    centre = (left + right) / 2, (bottom + top) / 2
    length, _ = case.room.wall("south")
    labels = [*Patches(1).labels, *suns.labels]
    errors, whole = [], []
    for i, each in enumerate(cases):
        a = case.accuracy.model_copy(update={"seed": 100 + i})
        fresh = simulation.transport(
            each.model_copy(update={"accuracy": a}), state, suns, light.sky.attrs["latitude"]
        )
        names = fill_at(each.facade["south"], length, *centre)
        composition = (names[:, None] == np.array(tiled.materials)).astype(float)
        ours = tiled.coefficients(composition, int(state == "shaded"))
        E, theirs = (
            (C["replicates"].sel(bin=labels).values * L).sum(axis=-1) for C in (ours, fresh)
        )
        mean = theirs.mean()
        if mean == 0:
            assert E.max() == 0
            continue
        (m, e), (n, f) = spread(E), spread(theirs)
        errors.append((np.abs(m - n) - 0.003 * mean) / np.hypot(e, f))
        (m, e), (n, f) = spread(E.mean(axis=1)), spread(theirs.mean(axis=1))
        whole.append((m / n - 1, np.hypot(e, f) / n))
    errors, (off, sigma) = np.array(errors), np.array(whole).T
    with capsys.disabled():
        print(
            f"\n{state}: mean E off by {100 * off.mean():+.3f} % in the mean, "
            f"{100 * off.std():.3f} % RMS, at most {100 * np.abs(off).max():.3f} % "
            f"(standard error {100 * sigma.mean():.3f} %); "
            f"sensors beyond 0.3 %: at most {errors.max():.2f} standard errors"
        )
    # The simulations have 8 replicates each.
    limit, of_sensors = (student.ppf(1 - 0.01 / n / 2, 7) for n in (off.size, errors.size))
    assert (np.abs(off) <= np.maximum(limit * sigma, 0.003)).all()
    assert errors.max() < of_sensors
    assert (errors > 3).mean() < 0.01
    assert abs(off.mean()) < 0.003


@pytest.mark.slow
def test_light_of_a_pipe_beside_tiles_is_counted(same):
    """E of the sky and of suns by the window and by a mirror pipe through the ceiling."""
    tables = {
        "site": {"latitude": 46.2, "longitude": 6.1, "timezone": 1},
        "period": {"months": [3], "days_per_week": 1},
        "room": {"size": [4.0, 5.0, 3.0], "floor": 0.3, "walls": 0.6, "ceiling": 0.8},
        "materials": {
            "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.12},
            "opal": {"type": "diffuser", "transmittance": 0.5, "reflectance": 0.3},
            "silver": {"type": "mirror", "reflectance": 0.95},
        },
        "components": {
            "pipe": {"type": "lightpipe", "centre": [2.0, 3.5], "width": 0.4, "height": 1.0,
                     "mirror": "silver"},
        },
        "sensors": {"corner": [0.5, 0.6, 0.8], "count": [3, 4], "spacing": 1.1},
        "accuracy": {"replicates": 16, "paths": 512, "sensor_sky_rays": 1024},
    }  # fmt: skip
    strips = [{"bottom": 0.9, "top": 1.8, "material": "glass"},
              {"bottom": 1.8, "top": 2.7, "material": "opal"}]  # fmt: skip
    case = Case.model_validate({**tables, "facade": {"south": {"strips": strips}}})
    light = daylight(case)

    heights = np.array([0.9, 1.8, 2.7])
    cut = TiledFacades.of_grid(case, "south", heights, 1, ("wall", "glass", "opal"))
    lit = elements.compute(cut.case, cut.panes, light.suns, case.accuracy, ALL_EFFECTS)
    tiled = TiledLight.of(cut, 2, (lit,))
    ours = tiled.coefficients(np.array([[0, 1, 0], [0, 0, 1]]))
    other = case.accuracy.model_copy(update={"seed": 99})
    fresh = simulation.transport(
        case.with_tables(accuracy=other), "open", light.suns, light.sky.attrs["latitude"]
    )
    sky = len(Patches(1).labels)
    for bins in (slice(0, sky), slice(sky, None)):
        E, theirs = (C["replicates"].values[..., bins].sum(axis=-1) for C in (ours, fresh))
        same(E, other=theirs, within=0.01)
