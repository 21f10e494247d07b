"""The sun where it is hard: horizon, zenith, north, poles, odd clocks, borders of patches."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import disk_solid_angle
from scipy.stats import norm

from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene as scenes
from drcmitsuba.sky import daylight as lights
from drcmitsuba.sky import luminances, sun_labels, sun_models, sun_position, weather
from drcmitsuba.sky.period import Period
from drcmitsuba.sky.sun import direction
from drcmitsuba.sky.sun_models import mesh
from drcmitsuba.sky.weather import Site
from drcmitsuba.transport.rays.shadow_rays import sun_deposit
from tests.fast import slowly

SITES = {
    "Barrow": Site("Barrow", 71.3, -156.8, -9.0, 10.0),
    "Singapore": Site("Singapore", 1.37, 103.98, 8.0, 15.0),
    "Sydney": Site("Sydney", -33.87, 151.21, 10.0, 20.0),
    "Delhi": Site("Delhi", 28.6, 77.2, 5.5, 216.0),
    "Kathmandu": Site("Kathmandu", 27.7, 85.3, 5.75, 1400.0),
    "Fiji": Site("Fiji", -18.1, 178.4, 12.0, 5.0),
    "South Pole": Site("South Pole", -90.0, 0.0, 12.0, 2835.0),
}
YEAR = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]").astype("datetime64[ns]")
MEEUS = 0.01 + 8.8 / 3600
"""Meeus states 0.01° for his low accuracy; the parallax, at most 8.8″, is left out of it [deg]."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def by_meeus(time, site):
    """Unit vectors to the sun: J. Meeus, Astronomical Algorithms, 2nd ed., chapters 12, 22, 25."""
    utc = time - np.timedelta64(round(site.timezone * 3600), "s")
    days = (utc - np.datetime64("2000-01-01T12:00")) / np.timedelta64(1, "D")
    T = (days + 68 / 86400) / 36525  # dynamical time is 68 s ahead
    L0 = 280.46646 + 36000.76983 * T + 0.0003032 * T**2
    M = np.radians(357.52911 + 35999.05029 * T - 0.0001537 * T**2)
    centre = (1.914602 - 0.004817 * T) * np.sin(M) + 0.019993 * np.sin(2 * M)
    centre += 0.000289 * np.sin(3 * M)
    node = np.radians(125.04 - 1934.136 * T)
    longitude = np.radians(L0 + centre - 0.00569 - 0.00478 * np.sin(node))
    obliquity = np.radians(23.439291 - 0.0130042 * T + 0.00256 * np.cos(node))
    declination = np.arcsin(np.sin(obliquity) * np.sin(longitude))
    ascension = np.arctan2(np.cos(obliquity) * np.sin(longitude), np.cos(longitude))
    sidereal = 280.46061837 + 360.98564736629 * days - 0.00478 * np.sin(node) * np.cos(obliquity)
    h = np.radians(sidereal + site.longitude) - ascension
    phi = np.radians(site.latitude)
    x = -np.cos(declination) * np.sin(h)
    y = np.cos(phi) * np.sin(declination) - np.sin(phi) * np.cos(declination) * np.cos(h)
    z = np.sin(phi) * np.sin(declination) + np.cos(phi) * np.cos(declination) * np.cos(h)
    return np.stack([x, y, z], axis=-1)


# Positions


@pytest.mark.parametrize("name", SITES)
def test_position_at_hard_places(name, holds):
    """Poles, zenith, 180° east, half hours: an independent almanac, every hour of the year."""
    sun = sun_position(YEAR, 1.0, SITES[name], "instant")
    off = np.linalg.norm(sun.direction.values - by_meeus(YEAR, SITES[name]), axis=1)
    holds("degrees from Meeus' low accuracy", np.degrees(off), MEEUS)
    middle = sun_position(YEAR, 1.0, SITES[name])
    d, azimuth = middle.direction.values, middle.solar_azimuth.values
    holds("length of the directions − 1", abs(np.linalg.norm(d, axis=1) - 1), 1e-14)
    holds("azimuths outside of 0 … 360", ~((azimuth >= 0) & (azimuth < 360)), 0)


def test_leap_day(holds):
    """29 February stands between its neighbours, in the year that has one."""
    days = np.array(["2016-02-28T12:00", "2016-02-29T12:00", "2016-03-01T12:00"], "datetime64[ns]")
    sun = sun_position(days, 1.0, SITES["Delhi"], "instant")
    off = np.linalg.norm(sun.direction.values - by_meeus(days, SITES["Delhi"]), axis=1)
    holds("degrees from Meeus' low accuracy", np.degrees(off), MEEUS)


def test_half_hour_zones_see_the_same_sun(holds):
    """A zone is a name for an instant: 5.5 and 5.75 h move the stamps, not the sun."""
    for zone in (5.5, 5.75, -3.5, 12.75):
        shift = np.timedelta64(round((zone - 5) * 3600), "s")
        a, b = (
            sun_position(t, 1.0, Site("x", 28.6, 77.2, z, 200.0))
            for t, z in ((YEAR[::7], 5.0), (YEAR[::7] + shift, zone))
        )
        holds(f"directions at {zone:+g} h", abs(a.direction.values - b.direction.values), 0)
        holds(f"labels missing at {zone:+g} h", ((sun_labels(a) == "") ^ (sun_labels(b) == "")), 0)


def test_polar_night_and_midnight_sun(holds):
    """Barrow: no hour of the polar night has a sun, every hour of the polar day has one.

    The centre of the disk stays down from 18 November to 23 January (by geometry; refraction and
    the upper limb shorten the almanacs' night by some days) and up from 12 May to 31 July.
    """
    site = SITES["Barrow"]
    up = sun_labels(sun_position(YEAR, 1.0, site)) != ""
    day = YEAR.astype("datetime64[D]").astype(str)
    night = (day >= "2015-11-21") | (day <= "2015-01-20")
    summer = (day >= "2015-05-14") & (day <= "2015-07-29")
    holds("suns in the polar night", up[night].sum(), 0)
    holds("hours without a sun in the polar day", (~up)[summer].sum(), 0)
    # A sun that shows for less than a twelfth of an hour may be missed.
    parts = np.arange(13) * np.timedelta64(5, "m")
    z = by_meeus((YEAR[:, None] + parts).ravel(), site).reshape(-1, 13, 3)[:, :, 2]
    highest = np.degrees(np.arcsin(z.max(axis=1)))
    clear = abs(highest) > MEEUS
    holds("hours lit in one almanac, dark in the other", (up != (highest > 0))[clear], 0)


# Clock and period


@pytest.mark.parametrize(
    "saving", [("03-29", "10-25"), ("10-04", "04-05"), ("01-02", "12-31"), ("02-28", "03-01")]
)
@pytest.mark.parametrize("step", [1.0, 0.5, 1 / 6])
def test_daylight_saving_keeps_every_hour(saving, step, holds):
    """Both changes of the clock, north and south, and at the turn of the year: none lost or twice.

    The months share out all stamps; working hours are ten a day whatever the clock does; and the
    clock is an hour ahead on exactly the days of summer.
    """
    count = round(8760 / step)
    length = np.timedelta64(round(step * 3600), "s")
    time = np.datetime64("2015-01-01", "ns") + np.arange(count) * length
    every = {"hours": (0, 24), "days_per_week": 7, "daylight_saving": saving}
    months = [Period(months=(m,), **every).select(time, step)[0] for m in range(1, 13)]
    holds("stamps in no month or two", abs(np.sort(np.concatenate(months)) != time), 0)
    for days, hours in ((5, 2610), (7, 3650)):
        kept, clock = Period(days_per_week=days, daylight_saving=saving).select(time, step)
        holds("working hours more or less", abs(len(kept) * step - hours), 1e-9)
        per_day = np.unique(clock.astype("datetime64[D]"), return_counts=True)[1]
        holds("working hours of a day but ten", abs(per_day * step - 10), 1e-9)
    kept, clock = Period(**every).select(time, step)
    ahead = np.unique((clock - kept).astype("timedelta64[m]").astype(int))
    holds("minutes ahead but 0 and 60", ~np.isin(ahead, [0, 60]), 0)
    first, last = (np.datetime64(f"2015-{day}") for day in saving)
    days = (last - first).astype("timedelta64[D]").astype(int) % 365
    summer = clock > kept
    holds("summer days", abs(summer.sum() * step / 24 - days), 1e-9)


def rows_of_file(site, suffix, leap):
    """A file with 1000 W/m² wherever its own sun is up, black at night, 8760 or 8784 hours."""
    first = "2016-01-01" if leap else "2015-01-01"
    last = "2017-01-01" if leap else "2016-01-01"
    time = np.arange(first, last, dtype="datetime64[h]").astype("datetime64[ns]")
    z = by_meeus(time + np.timedelta64(30, "m"), site)[:, 2]
    dni, dhi = np.where(z > 0, 500, 0), np.where(z > 0, 100, 0)
    stamps = zip(time.astype("datetime64[s]").tolist(), dni, dhi, strict=True)
    if suffix == ".epw":
        location = f"LOCATION,T,-,X,made,0,{site.latitude},{site.longitude},{site.timezone},10"
        head = [location, *(f"{w},0" for w in ("DESIGN", "TYPICAL", "GROUND", "HOLIDAYS"))]
        head += ["COMMENTS 1,", "COMMENTS 2,", "DATA PERIODS,1,1,Data,Sunday,1/1,12/31"]
        rest = ",".join("0" * 19)
        body = [
            f"{t.year},{t.month},{t.day},{t.hour + 1},60,?9,20.0,7.5,50,98100,0,0,300,"
            f"{a + b},{a},{b},{rest}"
            for t, a, b in stamps
        ]
    elif suffix == ".csv":
        columns = "Date (MM/DD/YYYY),Time (HH:MM),GHI (W/m^2),DNI (W/m^2),DHI (W/m^2)"
        place = f"{site.timezone},{site.latitude},{site.longitude},10"
        head = [f'1,"T",NC,{place}', f"{columns},Dew-point (C)"]
        body = [
            f"{t.month:02}/{t.day:02}/{t.year},{t.hour + 1:02}:00,{a + b},{a},{b},-9900"
            for t, a, b in stamps
        ]
    else:
        head = ["place T", f"latitude {site.latitude}", f"longitude {-site.longitude}"]
        head += [f"time_zone {-15 * site.timezone}", "site_elevation 10"]
        head += ["weather_data_file_units 1"]
        body = [f"{t.month} {t.day} {t.hour + 0.5} {a} {b}" for t, a, b in stamps]
    return "\n".join([*head, *body]) + "\n"


@pytest.mark.parametrize("suffix", [".epw", ".csv", ".wea"])
@pytest.mark.parametrize("leap", [False, True], ids=["365 days", "366 days"])
@pytest.mark.parametrize("name", slowly(["Barrow", "Kathmandu", "Sydney"], "Kathmandu", "Barrow"))
def test_year_of_a_file(suffix, leap, name, tmp_path, holds):
    """The leap day goes, all else keeps its clock; night is black to the last bit, day is not.

    A file that is shifted by an hour or by the zone's fraction puts sun into night hours.
    """
    file = tmp_path / f"made{suffix}"
    file.write_text(rows_of_file(SITES[name], suffix, leap))
    read = weather.read(file)
    holds("hours but 8760", abs(len(read.data.time) - 8760), 0)
    holds("leap days in silence", int(leap) - sum("29 February" in note for note in read.notes), 0)
    case = Case.model_validate({
        "weather": {"file": str(file)},
        "period": {"hours": (0, 24), "days_per_week": 7},
        "sensors": {"corner": (0.0, 0.0, 0.0), "count": (1, 1), "spacing": 1.0},
    })  # fmt: skip
    light = lights.daylight(case)
    L, sun = light.sky["sky"].values, light.sky["sun"].values
    night = read.data["dhi"].values + read.data["dni"].values == 0
    assert night.sum() > 1000
    holds("hours of the year but 8760", abs(len(L) - 8760), 0)
    holds("luminance at night", L[night].max() + sun[night].max(), 0)
    holds(
        "luminances that are not finite", ~np.isfinite(luminances.luminances(light)["L"].values), 0
    )
    # Not its luminance: the efficacy of direct light may be 0 at the horizon.
    dark = (light.sun["solar_zenith"].values >= 90) & (read.data["dni"].values > 0)
    holds("hours of sun without a sun", dark.sum(), 0)


# The disk


def cap(height, radius):
    """∫ max(0, cos θ) dΩ over a disk whose centre stands `height` above a horizon [rad].

    By θ from the disk's centre: a ring's cosines are sin h cos θ + cos h sin θ cos φ, and those
    above the horizon have φ up to arccos(−tan h / tan θ).
    """
    theta, step = np.linspace(0, radius, 20_001, retstep=True)
    theta = (theta[:-1] + theta[1:]) / 2
    edge = np.arccos(np.clip(-np.tan(height) / np.tan(theta), -1, 1))
    ring = np.sin(height) * np.cos(theta) * edge + np.cos(height) * np.sin(theta) * np.sin(edge)
    return (2 * ring * np.sin(theta)).sum() * step


HEIGHTS = np.array([-0.2, -0.05, 0.0, 0.05, 0.1, 0.249, 0.251, 1.0, 45.0, 89.9, 90.0])


@pytest.mark.parametrize("diameter", [0.5, 5.0])
def test_disk_on_the_horizon_of_a_sensor(diameter, holds):
    """Half-set disks, to the sensor's horizon: the exact integral, at every azimuth.

    A disk at 0.05° is 0.00087 high: float32 keeps 7 digits of it only where no 1 − cos occurs.
    """
    n, samples = 1024, 16
    azimuth = np.array([0, 1e-6, 90, 180, 270, 360 - 1e-6, 36.87])
    height = np.repeat(HEIGHTS, len(azimuth))
    d = direction(90 - height, np.tile(azimuth, len(HEIGHTS)))
    points, normals = (mi.Float(np.tile(v, n).astype(np.float32)) for v in ([0, 0, 0], [0, 0, 1]))
    D = sun_deposit(
        scenes.build([]), points, normals, suns=d, diameter=diameter, samples=samples, seed=5
    ).numpy().astype(float)  # fmt: skip
    exact = np.array([cap(np.radians(h), np.radians(diameter / 2)) for h in HEIGHTS])
    exact = np.repeat(exact, len(azimuth))
    error = D.std(axis=0, ddof=1) / np.sqrt(n)
    z = abs(D.mean(axis=0) - exact) / np.hypot(error, 3e-6 * exact)
    allowed = -norm.ppf((1 - (1 - 1e-4) ** (1 / len(z))) / 2)
    holds("standard errors from the exact integral", z, allowed)
    full = height > diameter / 2
    plain = np.pi * np.sin(np.radians(diameter / 2)) ** 2 * np.sin(np.radians(height[full]))
    holds("π sin²r cos θ of whole disks", abs(exact[full] / plain - 1), 1e-8)
    assert (error[full] < 1e-2 * exact[full]).all()


def test_sun_below_the_sensor_gives_nothing(holds):
    """A disk that is wholly below the sensor's horizon, by a hair, gives exactly zero."""
    d = direction(90 - np.array([-0.2501, -1.0, -90.0]), np.zeros(3))
    D = sun_deposit(
        scenes.build([]), mi.Float(0, 0, 0), mi.Float(0, 0, 1), suns=d, diameter=0.5,
        samples=64, seed=1,
    )  # fmt: skip
    holds("coefficient", D.numpy(), 0)


# Patches


def border_directions(patches):
    """Directions on every border of every patch, its corners, and one float32 step beside them."""
    low, high, west, east = patches.bounds[1:].T
    edges = []
    for altitude in (low, (low + high) / 2, high):
        for azimuth in (west, (west + east) / 2, east, west + 2 * np.pi, east - 2 * np.pi):
            edges.append(np.stack([altitude, azimuth], axis=-1))
    altitude, azimuth = np.concatenate(edges).T
    d = direction(90 - np.degrees(altitude), np.degrees(azimuth)).astype(np.float32)
    beside = [np.nextafter(d, np.float32(s)) for s in (-2, 2)]
    exact = [[0, 0, 1], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [-0.0, 1, 0], [-0.0, -1, 0]]
    exact += [[-1e-30, 1, 0], [1e-30, 1, 0], [1e-38, 1e-38, 1], [0, 1, -0.0]]
    return np.concatenate([d, *beside, np.array(exact, np.float32)])


@pytest.mark.parametrize("subdivision", range(1, 7))
def test_borders_of_patches(subdivision, holds):
    """Every direction has exactly one patch, one that it lies in or touches, always the same."""
    patches = Patches(subdivision)
    d = border_directions(patches)
    d = d[d[:, 2] >= 0]

    def looked_up(d):
        columns = (mi.Float(np.ascontiguousarray(c)) for c in d.T)
        return patch_index(mi.Vector3f(*columns), subdivision).numpy()

    patch = looked_up(d)
    holds("directions without a patch", (patch < 1) | (patch >= len(patches)), 0)
    order = np.random.default_rng(1).permutation(len(d))
    holds("directions with two patches", patch[order] != looked_up(d[order]), 0)
    alone = np.array([looked_up(d[i : i + 1])[0] for i in range(0, len(d), len(d) // 50)])
    holds("other patches when asked alone", alone != patch[:: len(d) // 50], 0)
    low, high, west, east = patches.bounds[patch].T
    x, y, z = d.astype(float).T
    level = np.hypot(x, y)
    altitude = np.arctan2(z, level)
    above = np.maximum(low - altitude, altitude - high)
    turn = (np.arctan2(x, y) - (west + east) / 2 + np.pi) % (2 * np.pi) - np.pi
    beside = np.where(patch == len(patches) - 1, 0, (abs(turn) - (east - west) / 2) * level)
    # Float32 angles: half a unit in the last place of 2π in azimuth, times its rounding steps.
    holds("radians outside of the patch", np.maximum(np.maximum(above, beside), 0), 1.5e-6)
    total = patches.solid_angles[1:].sum() / (2 * np.pi)
    projected = patches.projected_solid_angles[1:].sum() / np.pi
    holds("sums of solid angles", [abs(total - 1), abs(projected - 1)], 1e-13)


def hard_directions():
    """Zenith, horizon, north from both sides, borders of patches, axes; unit vectors, float64."""
    borders = Patches().bounds[1:]
    altitude, azimuth = np.degrees(np.concatenate([borders[:, [0, 2]], borders[:, [1, 3]]])).T
    d = [direction(90 - altitude, azimuth)]
    heights = np.array([1e-9, 0.05, 6.0, 45.0, 84.0, 90 - 1e-9, 90.0])
    d += [direction(90 - heights, np.full(len(heights), a)) for a in (0, 1e-9, 180, 360 - 1e-9)]
    d = np.concatenate(d)
    return d[d[:, 2] > 0]


@pytest.mark.parametrize("latitude", [-90.0, -66.6, -33.9, 0.0, 1.37, 23.44, 66.56, 71.3, 90.0])
def test_sun_models_keep_the_light(latitude, holds):
    """However the sun is spread, its light stays: on borders, at the zenith, at any latitude."""
    d = hard_directions()
    up, diameter = np.ones(len(d), bool), 0.5
    omega = disk_solid_angle(diameter)
    for mf in (1, 2, 4):
        patches = Patches(mf)
        spread = sun_models.spread_over_patches(d, up, patches, diameter)
        size = dict(zip(patches.labels, patches.solid_angles, strict=True))
        light = (spread.weights * np.vectorize(size.get)(spread.bins)).sum(axis=1)
        holds(f"three-phase, MF {mf}: light", abs(light / omega - 1), 1e-12)
    _, blend = sun_models.moved_to_patch(d, up, diameter)
    holds("five-phase: light", abs(blend.weights.sum(axis=1) - 1), 0)
    places, blend = sun_models.between_daysim_suns(d, up, latitude, diameter)
    holds("daysim: light", abs(blend.weights.sum(axis=1) - 1), 1e-12)
    holds("daysim: negative weights", np.maximum(-blend.weights, 0), 0)
    known = {*places.labels}
    nameless = [
        b not in known for b, w in zip(blend.bins.flat, blend.weights.flat, strict=True) if w
    ]
    holds("daysim: bins that are no suns", nameless, 0)
    holds("daysim: suns below 2°", np.maximum(0.0349 - places.directions[:, 2], 0), 1e-4)
    nodes = mesh.nodes_of(d, mesh.COARSEST)
    blend = mesh.blend(d, up, [mesh.label(node) for node in nodes])
    holds("mesh: light", abs(blend.weights.sum(axis=1) - 1), 1e-12)
    holds("mesh: negative weights", np.maximum(-blend.weights, 0), 1e-12)


@pytest.mark.parametrize("name", ["Barrow", "Singapore", "Sydney", "South Pole"])
def test_mesh_covers_every_sun_of_the_year(name, holds):
    """The mesh knows the latitude only: each hour's sun must lie in one of its triangles."""
    site = SITES[name]
    sun = sun_position(YEAR, 1.0, site)
    up = sun_labels(sun) != ""
    nodes = mesh.nodes_of(mesh.possible_suns(site.latitude), mesh.COARSEST)
    blend = mesh.blend(sun.direction.values, up, [mesh.label(node) for node in nodes])
    holds("suns beside the mesh", abs(blend.weights.sum(axis=1)[up] - 1), 1e-12)
    assert dr.all(mi.Bool(np.isfinite(nodes).all(axis=1)))
