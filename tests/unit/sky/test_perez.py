"""Perez sky: Radiance's own output, exact integrals, convergence of patch means, and edge cases."""

import csv

import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import PatchCentres, PatchMeans, Perez, perez, radiance
from drcmitsuba.sky.sun import direction
from tests import REFERENCE

RADIANCE_DEW_POINT = 11.0
"""gendaymtx's dew point [deg C] where a WEA file has none."""


def table(name):
    with (REFERENCE / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def stamps(n):
    return np.datetime64("2015-06-01T10:00", "ns") + np.arange(n) * np.timedelta64(1, "h")


def sun_at(zenith, azimuth, time=None):
    zenith, azimuth = np.broadcast_arrays(np.atleast_1d(zenith).astype(float), azimuth)
    time = stamps(len(zenith)) if time is None else time
    return xr.Dataset(
        {
            "solar_zenith": ("time", zenith),
            "solar_azimuth": ("time", azimuth),
            "direction": (("time", "axis"), direction(zenith, azimuth)),
        },
        coords={"time": time, "axis": ["x", "y", "z"]},
    )


def weather(sun, dni, dhi, dew_point=np.nan):
    n = sun.sizes["time"]
    columns = {"dni": dni, "dhi": dhi, "dew_point": dew_point}
    return xr.Dataset(
        {k: ("time", np.broadcast_to(v, n).astype(float)) for k, v in columns.items()},
        coords={"time": sun.time},
    )


def random_hours(n, seed=1):
    """Clear, hazy and overcast hours with any sun above 1 degree."""
    rng = np.random.default_rng(seed)
    sun = sun_at(rng.uniform(2, 89, n), rng.uniform(0, 360, n))
    extraterrestrial = 1367 * np.cos(np.radians(sun.solar_zenith.to_numpy()))
    dhi = extraterrestrial * rng.uniform(0.05, 0.5, n)
    dni = 900 * rng.uniform(0, 1, n) * (rng.random(n) < 0.7)
    return weather(sun, dni, dhi, rng.uniform(-10, 20, n)), sun


def test_coefficients_are_the_published_ones():
    published = [
        [[float(row[f"{p}{i}"]) for i in range(1, 5)] for p in "abcde"]
        for row in table("perez_1993.csv")
    ]
    np.testing.assert_array_equal(perez.DISTRIBUTION, published)
    rows = table("perez_1990.csv")
    for name, ours in (
        ("diffuse_horizontal", perez.DIFFUSE_EFFICACY),
        ("direct_normal", perez.DIRECT_EFFICACY),
    ):
        chosen = [row for row in rows if row["quantity"] == name]
        np.testing.assert_array_equal(ours, [[float(row[k]) for k in "abcd"] for row in chosen])
    np.testing.assert_array_equal(
        perez.CLEARNESS_EDGES, [float(row["eps_hi"]) for row in chosen][:-1]
    )


def test_parameters_are_those_of_gendaylit():
    rows = [r for r in table("gendaylit.csv") if r["status"] == "ok"]
    assert len(rows) == 42
    dni, dhi, z = (
        np.array([float(r[k]) for r in rows]) for k in ("dir_norm_Wm2", "diff_hor_Wm2", "sun_dz")
    )
    day = np.array(
        [
            (np.datetime64(f"2015-{int(r['month']):02d}-{int(r['day']):02d}")
             - np.datetime64("2014-12-31")).astype(int)
            for r in rows
        ]
    )  # fmt: skip
    model = perez.parameters(dni, dhi, np.degrees(np.arccos(z)), day)

    def column(name):
        return np.array([float(r[name]) for r in rows])

    np.testing.assert_allclose(model.clearness, column("epsilon"), atol=6e-5)
    np.testing.assert_allclose(model.brightness, column("delta"), atol=6e-5)
    for ours, name in zip(model.distribution, ("c1", "c2", "c3", "c4", "c5"), strict=True):
        # Six printed digits, of a sun printed to six digits.
        np.testing.assert_allclose(ours, column(name), atol=2e-5, err_msg=name)

    _, direct = perez.efficacies(model, perez.precipitable_water(np.full(len(dni), np.nan)))
    per_lux = np.where(column("out_flag") == 0, 179.0, 1.0) * 2 * np.pi
    theirs = column("solar_radiance") * per_lux * (1 - np.cos(np.radians(0.533 / 2)))
    # gendaylit prints four digits, and no sun where the clearness is 1.
    np.testing.assert_allclose(dni * direct, theirs, rtol=5.1e-4)


def test_hours_that_gendaylit_refuses_are_black():
    rows = [r for r in table("gendaylit.csv") if r["status"] != "ok"]
    assert rows
    zenith = np.degrees(np.arccos([float(r["sun_dz"]) for r in rows]))
    sun = sun_at(zenith, 90.0)
    columns = ("dir_norm_Wm2", "diff_hor_Wm2")
    dni, dhi = (np.array([float(r[k]) for r in rows]) for k in columns)
    L = radiance(weather(sun, dni, dhi), sun, model=Perez())
    assert (L.sky == 0).all()
    assert (L["sun"] == 0).all()
    assert (L.sun_bin == "").all()


def radiance_sun(month, day, hour):
    """Zenith and azimuth [deg] by Radiance's sun.c for Geneva; gendaymtx used this sun."""
    jd = (np.datetime64(f"2015-{month:02d}-{day:02d}") - np.datetime64("2014-12-31")).astype(int)
    latitude, longitude, zone = np.radians(46.25), 6.13, 1.0
    declination = 0.4093 * np.sin(2 * np.pi / 365 * (jd - 81))
    adjust = 0.170 * np.sin(4 * np.pi / 373 * (jd - 80))
    adjust -= 0.129 * np.sin(2 * np.pi / 355 * (jd - 8))
    turn = np.pi / 12 * (hour + adjust + longitude / 15 - zone)
    sin_d, cos_d = np.sin(declination), np.cos(declination)
    up = np.sin(latitude) * sin_d - np.cos(latitude) * cos_d * np.cos(turn)
    east = cos_d * np.sin(turn)
    north = np.cos(latitude) * sin_d + np.sin(latitude) * cos_d * np.cos(turn)
    # sun.c counts the turn from midnight: east and west change places.
    return np.degrees(np.arccos(up)), np.degrees(np.arctan2(east, north)) % 360


def golden_hours():
    """Sun, weather, printed radiances of the sky (time, bin), and the sun's illuminances (time)."""
    rows = table("gendaymtx.csv")
    hours = [k for k in rows[0] if k not in ("mode", "patch")]
    times = [(int(m), int(d), float(h)) for m, d, h in (k.split("-") for k in hours)]
    printed: dict[str, list] = {}
    for row in rows:
        printed.setdefault(row["mode"], []).append([float(row[h]) for h in hours])
    (dni,), (dhi,) = (np.array(printed[name]) for name in ("dni", "dhi"))
    lit = [int(row["patch"]) for row in rows if row["mode"] == "sun"]
    sunlight = 179 * Patches().solid_angles[lit] @ np.array(printed["sun"])
    time = np.array(
        [f"2015-{m:02d}-{d:02d}T{int(h):02d}:00" for m, d, h in times], dtype="datetime64[ns]"
    )
    zenith, azimuth = np.array([radiance_sun(*t) for t in times]).T
    sun = sun_at(zenith, azimuth, time)
    return (
        sun,
        weather(sun, dni, dhi, RADIANCE_DEW_POINT),
        np.array(printed["sky"]).T,
        sunlight,
    )


def test_centre_values_are_those_of_gendaymtx():
    sun, data, theirs, _ = golden_hours()
    L = radiance(data, sun, model=Perez(PatchCentres()))
    ours = L.sky.to_numpy() / 179
    last_digit = 10.0 ** (np.floor(np.log10(np.maximum(theirs, 1e-9))) - 2)
    assert (theirs > 0).mean() > 0.9
    assert (ours[theirs == 0] == 0).all()
    assert (abs(ours - theirs) / last_digit)[theirs > 0].max() < 0.51


def test_sun_is_that_of_gendaymtx():
    sun, data, _, theirs = golden_hours()
    L = radiance(data, sun, model=Perez())
    # Four patches, each printed with three digits.
    np.testing.assert_allclose(L.direct_normal_illuminance, theirs, rtol=3e-3)
    assert L.direct_normal_illuminance.max() > 8e4


def test_diffuse_illuminance_is_exact():
    data, sun = random_hours(300)
    for patches in (Patches(), Patches(2)):
        L = radiance(data, sun, model=Perez(), patches=patches)
        sky = L.sky.to_numpy()[:, 1:]
        np.testing.assert_allclose(
            sky @ patches.projected_solid_angles[1:], L.diffuse_horizontal_illuminance, rtol=1e-12
        )
        assert (sky >= 0).all()
    model = perez.parameters(
        data.dni.to_numpy(),
        data.dhi.to_numpy(),
        sun.solar_zenith.to_numpy(),
        data.time.dt.dayofyear.to_numpy(),
    )
    diffuse, _ = perez.efficacies(model, perez.precipitable_water(data.dew_point.to_numpy()))
    np.testing.assert_allclose(L.diffuse_horizontal_illuminance, data.dhi * diffuse, rtol=1e-12)


def own_patch(sun, patches):
    low, high, west, east = np.degrees(patches.bounds[1:].T)
    altitude = 90 - np.clip(sun.solar_zenith.to_numpy()[:, None], 3, 90)
    turn = (sun.solar_azimuth.to_numpy()[:, None] - west) % 360
    return (altitude >= low) & (altitude < high) & (turn < east - west)


def test_patch_means_converge_and_the_default_is_close():
    data, sun = random_hours(120, seed=2)
    patches = Patches()
    own = own_patch(sun, patches)
    assert (own.sum(axis=1) == 1).all()

    def relative_error(means):
        values = Perez(means).luminances(data, sun, patches).sky
        return abs(values - exact) / np.maximum(exact, 0.01 * exact.mean(axis=1, keepdims=True))

    exact = Perez(PatchMeans((32, 24), (48, 48))).luminances(data, sun, patches).sky
    coarse = relative_error(PatchMeans((2, 2), (3, 3)))
    medium = relative_error(PatchMeans((4, 4), (6, 6)))
    default = relative_error(PatchMeans())
    assert coarse.mean() > 5 * medium.mean() > 5 * default.mean()
    assert default[own].max() < 0.01
    assert default[~own].max() < 0.001


def test_patch_mean_is_the_mean_of_random_directions():
    """Independent of Gauss nodes: 40 000 uniform directions in the sun's patch and two more."""
    sun = sun_at(40.0, 131.0)
    data = weather(sun, 700.0, 120.0)
    patches = Patches()
    sky = Perez().luminances(data, sun, patches).sky[0]
    a, b, c, d, e = perez.parameters(
        np.array([700.0]), np.array([120.0]), np.array([40.0]), np.array([152])
    ).distribution[:, 0]
    rng = np.random.default_rng(4)

    def mean(patch):
        low, high, west, east = patches.bounds[patch + 1]
        z = rng.uniform(np.sin(low), np.sin(high), 40_000)
        azimuth = np.degrees(rng.uniform(west, east, z.size))
        w = direction(np.degrees(np.arccos(z)), azimuth)
        gamma = np.arccos(np.clip(w @ sun.direction.to_numpy()[0], -1, 1))
        luminance = (1 + a * np.exp(b / z)) * (1 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)
        return luminance.mean(), luminance.std() / 200

    own = int(np.flatnonzero(own_patch(sun, patches)[0])[0])
    means = np.array([mean(p) for p in (own, 3, 144)])
    ratio = means / sky[[own, 3, 144], None]
    scale = ratio[1, 0]  # the smoothest patch
    assert (abs(ratio[:, 0] - scale) < 5 * np.hypot(ratio[:, 1], ratio[1, 1])).all()
    assert (ratio[:, 1] < 0.005 * scale).all()


def test_sky_turns_with_the_sun():
    """The sun turned by three patches of the lowest row turns its patches."""
    sun = sun_at([50.0, 50.0], [90.0, 126.0])
    sky = Perez().luminances(weather(sun, 600.0, 150.0), sun, Patches()).sky
    row = sky[:, :30] / sky[:, :30].sum(axis=1, keepdims=True)
    np.testing.assert_allclose(np.roll(row[0], 3), row[1], rtol=1e-12)


def test_sky_is_mirrored_with_the_sun():
    sun = sun_at([50.0, 50.0], [75.0, 285.0])
    L = radiance(weather(sun, 600.0, 150.0), sun, model=Perez()).sky.to_numpy()
    d = Patches().directions[1:]
    mirror = np.array([np.argmax(d @ v) for v in d * [-1, 1, 1]])
    np.testing.assert_allclose(L[0, 1:], L[1, 1:][mirror], rtol=1e-12)


def test_sun_and_ground():
    sun = sun_at([30.0, 80.0], [180.0, 260.0])
    data = weather(sun, 800.0, 100.0)
    for diameter in (0.5, 0.533):
        L = radiance(data, sun, model=Perez(), ground_reflectance=0.3, sun_diameter=diameter)
        direct = L.direct_normal_illuminance
        np.testing.assert_allclose(L["sun"] * disk_solid_angle(diameter), direct, rtol=1e-14)
        horizontal = direct * np.cos(np.radians(sun.solar_zenith))
        expected = 0.3 / np.pi * (L.diffuse_horizontal_illuminance + horizontal)
        np.testing.assert_allclose(L.sky.sel(bin="ground"), expected, rtol=1e-12)
    assert disk_solid_angle(0.5) == pytest.approx(5.981e-5, rel=1e-4)


def test_labels_do_not_depend_on_the_weather():
    sun = sun_at([30.0, 89.9, 90.1], [180.0, 260.0, 265.0])
    labels = [
        radiance(weather(sun, dni, 50.0), sun, model=Perez()).sun_bin.to_numpy()
        for dni in (0.0, 500.0)
    ]
    assert labels[0].tolist() == ["sun_2015-06-01T10:00", "sun_2015-06-01T11:00", ""]
    np.testing.assert_array_equal(labels[0], labels[1])
    L = radiance(weather(sun, 0.0, 50.0), sun, model=Perez())
    assert (L["sun"] == 0).all()
    assert L.sky.dims == ("time", "bin")
    assert L.bin.to_numpy().tolist() == Patches().labels


def test_twilight_glows_toward_the_sun_that_has_set():
    sun = sun_at([94.0], [270.0])
    L = radiance(weather(sun, 30.0, 8.0), sun, model=Perez())
    assert L["sun"].item() == 0
    assert L.direct_normal_illuminance.item() == 0
    west, east = L.sky.sel(bin="sky_023").item(), L.sky.sel(bin="sky_009").item()
    assert west > east > 0
    assert 8 * 60 < L.diffuse_horizontal_illuminance.item() < 8 * 200


def test_sun_without_diffuse_light():
    sun = sun_at([20.0], [180.0])
    L = radiance(weather(sun, 900.0, 0.0), sun, model=Perez())
    assert (L.sky.to_numpy()[:, 1:] == 0).all()
    assert L.direct_normal_illuminance.item() > 900 * 60


@pytest.mark.parametrize("patch_values", [PatchMeans(), PatchCentres()], ids=["means", "centres"])
def test_impossible_irradiances_stay_finite(patch_values):
    grid = np.array(
        [
            (dni, dhi, zenith)
            for dni in (0, 1e-9, 1, 300, 2000, 1e5)
            for dhi in (0, 1e-9, 1, 100, 800, 1e5)
            for zenith in (0, 1e-6, 2.9, 45, 85, 89.999, 90, 91, 150, 180)
        ]
    )
    sun = sun_at(grid[:, 2], 200.0)
    L = radiance(weather(sun, grid[:, 0], grid[:, 1]), sun, model=Perez(patch_values))
    for name in ("sky", "sun", "direct_normal_illuminance", "diffuse_horizontal_illuminance"):
        values = L[name].to_numpy()
        assert np.isfinite(values).all(), name
        assert (values >= 0).all(), name
    lit = grid[:, 1] > 0
    assert (L.diffuse_horizontal_illuminance.to_numpy()[lit] > 0).all()
    assert (L.diffuse_horizontal_illuminance.to_numpy()[~lit] == 0).all()


def test_missing_dew_point_is_two_centimetres_of_water():
    np.testing.assert_allclose(
        perez.precipitable_water(np.array([np.nan, 10.9735, 0.0])), [2.0, 2.0, 0.927743], rtol=1e-5
    )
    sun = sun_at([30.0], [180.0])
    with_nan = radiance(weather(sun, 700.0, 90.0), sun, model=Perez())
    without = radiance(weather(sun, 700.0, 90.0).drop_vars("dew_point"), sun, model=Perez())
    xr.testing.assert_identical(with_nan, without)


def test_a_sky_does_not_depend_on_its_neighbours_in_time():
    data, sun = random_hours(300)
    whole = Perez().luminances(data, sun, Patches())
    part = slice(141, 150)
    alone = Perez().luminances(data.isel(time=part), sun.isel(time=part), Patches())
    np.testing.assert_allclose(alone.sky, whole.sky[part], rtol=1e-12)


def test_wrong_input_is_refused():
    sun = sun_at([30.0, 40.0], [180.0, 190.0])
    data = weather(sun, [1.0, np.nan], 1.0)
    with pytest.raises(InputError, match=r"dni: nan W/m2 at 2015-06-01T11:00"):
        radiance(data, sun, model=Perez())
    with pytest.raises(InputError, match="dni: no such irradiance"):
        radiance(data.drop_vars("dni"), sun, model=Perez())
    with pytest.raises(InputError, match="dhi: -1"):
        radiance(weather(sun, 1.0, -1.0), sun, model=Perez())
    with pytest.raises(InputError, match="times"):
        radiance(weather(sun, 1.0, 1.0), sun.isel(time=[1, 0]), model=Perez())
    with pytest.raises(InputError, match="ground_reflectance"):
        radiance(weather(sun, 1.0, 1.0), sun, model=Perez(), ground_reflectance=1.1)
    with pytest.raises(InputError, match="sun_diameter"):
        radiance(weather(sun, 1.0, 1.0), sun, model=Perez(), sun_diameter=0.0)
