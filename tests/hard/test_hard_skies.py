"""Sky models at their corners: finite, never negative, and exactly the light that they promise."""

import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.sky import CieSky, PatchCentres, PatchMeans, Perez, Sunshine, perez, radiance
from drcmitsuba.sky.cie import GENSKY
from drcmitsuba.sky.sun import direction

ZENITHS = np.array(
    [
        0.0,
        1e-9,
        2.9,
        3.0,
        3.1,
        6.0,
        45.0,
        80.0,
        87.0,
        89.0,
        89.95,
        90 - 1e-9,
        90.0,
        90.05,
        96.0,
        180,
    ]
)
DAYS = ["2015-01-03T12:00", "2015-06-21T12:00", "2015-12-31T23:00"]


def stamps(n):
    """`n` hours, the days of the earth's nearest and farthest distance among them."""
    return np.tile(np.array(DAYS, "datetime64[ns]"), -(-n // 3))[:n]


def hours(zenith, dni, dhi, azimuth=0.0, dew_point=np.nan):
    """Sun and weather of every combination, as the models take them."""
    grid = np.meshgrid(zenith, dni, dhi, azimuth, dew_point, indexing="ij")
    return listed(*(g.ravel() for g in grid))


def listed(zenith, dni, dhi, azimuth, dew_point):
    """Sun and weather of hours one by one."""
    time = stamps(len(zenith))
    sun = xr.Dataset(
        {
            "solar_zenith": ("time", zenith),
            "solar_azimuth": ("time", azimuth),
            "direction": (("time", "axis"), direction(zenith, azimuth)),
        },
        coords={"time": time, "axis": ["x", "y", "z"]},
    )
    columns = {"dni": dni, "dhi": dhi, "dew_point": dew_point}
    return xr.Dataset({k: ("time", v) for k, v in columns.items()}, {"time": time}), sun


@pytest.fixture
def worst(holds):
    """Collect the worst of each invariant over a test; asserted, and printed, once at its end."""
    largest = {}

    def worst(invariant, measured, allowed):
        measured = np.append(np.asarray(measured, float).ravel(), 0)
        largest[invariant] = max(measured.max(), largest.get(invariant, (0, 0))[0]), allowed

    yield worst
    for invariant, (measured, allowed) in largest.items():
        holds(invariant, measured, allowed)


def check(data, sun, model, holds, subdivision=1):
    """Assert that a sky is finite, not negative, black at night, and integrates to what it says."""
    patches = Patches(subdivision)
    L = radiance(data, sun, model=model, patches=patches)
    sky, direct, diffuse = (
        L[k].values for k in ("sky", "direct_normal_illuminance", "diffuse_horizontal_illuminance")
    )
    everything = np.column_stack([sky, L["sun"].values, direct, diffuse])
    holds("values that are not finite", ~np.isfinite(everything), 0)
    holds("negative values", everything < 0, 0)
    weights = model.patch_values.horizontal(patches)
    integral = sky[:, 1:] @ weights
    holds(
        "integral of the sky − diffuse illuminance",
        abs(integral - diffuse) / np.maximum(diffuse, 1e-300),
        1e-12,
    )
    holds("direct light of a sun that is down", direct[sun.solar_zenith.values >= 90], 0)
    up = np.maximum(np.cos(np.radians(sun.solar_zenith.values)), 0)
    ground = 0.2 / np.pi * (diffuse + direct * up)
    holds("ground", abs(sky[:, 0] - ground) / np.maximum(ground, 1e-300), 1e-12)
    return L


MODELS = {"means": Perez(), "centres": Perez(PatchCentres())}


@pytest.mark.parametrize("subdivision", [1, 4])
@pytest.mark.parametrize("values", MODELS)
def test_perez_anywhere(values, subdivision, worst):
    """Zero diffuse, zero direct, more than the sun has (1367 W/m²), sun at and below the horizon.

    Among them overcast at the horizon, and a diffuse irradiance with the sun 90° below it. A dew
    point of −80 and 60 °C is beyond any weather, and drives the efficacies below zero.
    """
    data, sun = hours(
        ZENITHS, [0.0, 1e-3, 50.0, 900.0, 1367.0, 1500.0],
        [0.0, 1e-12, 1e-3, 1.0, 100.0, 700.0, 1500.0],
        azimuth=[0.0, 359.999], dew_point=[np.nan, -80.0, 60.0] if subdivision == 1 else np.nan,
    )  # fmt: skip
    L = check(data, sun, MODELS[values], worst, subdivision)
    worst("diffuse light from none", L.diffuse_horizontal_illuminance.values[data.dhi == 0], 0)
    worst("direct light from none", L.direct_normal_illuminance.values[data.dni == 0], 0)


def test_perez_at_the_borders_of_clearness(worst):
    """On both sides of 1.065, 1.23, … the hour takes one of the two bins, whole.

    ε lands within a few units in the last place of the border: either side is right, a mixture or
    a bin further away is not.
    """
    zenith = np.array([5.0, 40.0, 70.0, 89.0, 90.0])
    cubed = 1.041 * np.radians(zenith) ** 3
    for i, edge in enumerate(perez.CLEARNESS_EDGES):
        for side in (-1e-9, -1e-15, 0.0, 1e-15, 1e-9):
            dhi = np.full(len(zenith), 100.0)
            dni = dhi * (edge * (1 + side) - 1) * (1 + cubed)
            data, sun = listed(zenith, dni, dhi, np.zeros(5), np.full(5, np.nan))
            check(data, sun, Perez(), worst)
            model = perez.parameters(dni, dhi, zenith, np.full(5, 172))
            wrong = (model.bin != i) & (model.bin != i + 1)
            worst("hours in another bin", wrong, 0)
            if abs(side) == 1e-9:
                worst("hours on the wrong side", model.bin != i + (side > 0), 0)
    beyond = perez.parameters(np.array([1e6]), np.array([1e-9]), np.array([20.0]), np.array([1]))
    worst("ε above 12 leaves its bin", beyond.bin != 7, 0)


def test_perez_where_the_formula_is_negative(worst):
    """Hours whose formula gives negative luminances somewhere: these are 0, the integral stays."""
    rng = np.random.default_rng(4)
    n = 4000
    zenith, dhi = rng.uniform(0, 90, n), 10 ** rng.uniform(-1, 3, n)
    dni = 10 ** rng.uniform(-1, 3.2, n)
    day = np.full(n, 172)
    a, b, c, d, e = perez.parameters(dni, dhi, zenith, day).distribution[:, :, None]
    towards, sun = Patches().directions[1:], direction(np.clip(zenith, 3, 90), np.zeros(n))
    gamma = np.arccos(np.clip(sun @ towards.T, -1, 1))
    gradation = 1 + a * np.exp(b / towards[:, 2])
    formula = gradation * (1 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)
    # Where it is negative all over, a uniform sky stands in.
    negative = np.flatnonzero((formula < 0).any(axis=1) & (formula > 0).any(axis=1))
    assert len(negative) > 50, "no hour of these is the hard case"
    k = negative[:400]
    data, sun = listed(zenith[k], dni[k], dhi[k], np.zeros(len(k)), np.full(len(k), np.nan))
    L = check(data, sun, Perez(PatchCentres()), worst)
    centre = formula[k] < 0
    worst("light where the formula is negative", L["sky"].values[:, 1:][centre], 0)
    check(data, sun, Perez(), worst)


def test_perez_does_not_lose_patches_to_their_nodes(worst):
    """Finer nodes change nothing that matters in the hardest hours: low suns of all clearnesses.

    The gradation exp(b / cos ζ) is steepest on the horizon and the glow exp(dγ) has its cusp in
    the sun: 0.1 % of the sky's mean is what `Perez` promises.
    """
    rng = np.random.default_rng(7)
    zenith = np.array([85.0, 89.0, 89.95, 90.0, 95.0])
    data, sun = hours(zenith, [0.0, 100.0, 800.0], [5.0, 80.0], azimuth=rng.uniform(0, 360, 3))
    plain, fine = (
        radiance(data, sun, model=Perez(means))["sky"].values[:, 1:]
        for means in (PatchMeans(), PatchMeans((24, 15), (40, 40)))
    )
    off = abs(plain - fine) / np.maximum(fine, fine.mean(axis=1, keepdims=True))
    worst("share of a patch's luminance", off, 2e-3)


def test_cie_skies_anywhere(worst):
    """All standard skies with the sun in the zenith, on the horizon, and below it."""
    data, sun = hours(ZENITHS, [0.0], [0.0], azimuth=[0.0, 359.999])
    up = sun.solar_zenith.values < 90
    for kind in (*range(1, 17), *GENSKY):
        for subdivision in (1, 4):
            L = check(data, sun, CieSky(kind, 12_345.0), worst, subdivision)
            diffuse = L.diffuse_horizontal_illuminance.values
            worst("diffuse illuminance asked for", abs(diffuse[up] / 12_345 - 1), 1e-12)
            worst("luminance of the night", L["sky"].values[~up], 0)
        check(data, sun, CieSky(kind, 0.0), worst)
    for kind in GENSKY:
        for turbidity in (1.0, 20.0):
            check(data, sun, CieSky(kind, turbidity=turbidity), worst)


def test_sunshine_at_its_ends(worst):
    """Never and always sunny months, the first and last minute of the year, 29 February."""
    data, sun = hours(ZENITHS, [0.0], [0.0], azimuth=[0.0, 180.0])
    for probability in ((0.0,) * 12, (1.0,) * 12, (0.0, 1.0) * 6):
        check(data, sun, Sunshine(probability), worst)
    ends = np.array(["2016-02-29T12:00", "2015-12-31T23:59", "2016-12-31T23:59"], "datetime64[ns]")
    kinds = Sunshine((1.0,) * 12).kinds(ends)
    worst("hours that are not sunny", kinds != "clear_with_sun", 0)
    worst("hours that are sunny", Sunshine((0.0,) * 12).kinds(ends) == "clear_with_sun", 0)
