"""CIE skies: values worked by hand, exact integrals, and the gensky program itself."""

import csv
import os
import re
import subprocess

import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import CieSky, PatchCentres, cie, radiance
from drcmitsuba.sky.sun import direction
from tests import REFERENCE, skips
from tests.radiance import home

OPTION = {
    "clear": "-s",
    "clear_with_sun": "+s",
    "intermediate": "-i",
    "intermediate_with_sun": "+i",
    "overcast": "-c",
}
ZENITH = np.array([0.0, 0.0, 1.0])


def sun_at(zenith, azimuth=180.0):
    zenith, azimuth = np.broadcast_arrays(np.atleast_1d(zenith).astype(float), azimuth)
    time = np.datetime64("2015-06-01T10:00", "ns") + np.arange(len(zenith)) * np.timedelta64(1, "h")
    return xr.Dataset(
        {
            "solar_zenith": ("time", zenith),
            "solar_azimuth": ("time", azimuth),
            "direction": (("time", "axis"), direction(zenith, azimuth)),
        },
        coords={"time": time, "axis": ["x", "y", "z"]},
    )


def luminance(kind, d, sun):
    """L / Lz in directions d (..., 3) under the sun in a direction (..., 3)."""
    return cie.relative(kind, d[..., 2], (d * sun).sum(axis=-1), sun[..., 2])


def light(model, sun):
    return radiance(xr.Dataset(coords={"time": sun.time}), sun, model=model)


def test_table_is_that_of_iso_15469():
    with (REFERENCE / "iso_15469.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_array_equal(cie.ISO_15469, [[float(row[k]) for k in "abcde"] for row in rows])


@pytest.mark.parametrize("kind", range(1, 17))
def test_zenith_is_one(kind):
    assert luminance(kind, ZENITH, direction(52.0, 180.0)) == pytest.approx(1, rel=1e-12)


# Worked with a pocket calculator from ISO 15469's formula.
@pytest.mark.parametrize(
    ("kind", "zenith", "azimuth", "sun_zenith", "expected"),
    [
        (1, 90, 20, 40, 1 / 2.98634),  # 1 / (1 + 4 × 0.496585): the horizon of the overcast sky
        (3, 90, 300, 40, 1 / 1.494262),  # 1 / (1 + 1.1 × 0.449329)
        (5, 75, 123, 10, 1.0),
        (16, 90, 0, 70, 1 / 3),
        (16, 60, 0, 70, 2 / 3),
        # φ(60°) = 1 − 0.527292, φ(0) = 1 − 0.726149; f(0) = 11.360167, f(60°) = 1.454806
        (12, 60, 180, 60, 0.472708 / 0.273851 * 11.360167 / 1.454806),
        # f(90°) = 1, f(30°) = 1 + 2 (0.455938 − 0.094780) + 0.15 × 0.75, γ = 90°: sun in the south
        (6, 90, 90, 30, 1 / 1.834816),
    ],
)  # fmt: skip
def test_iso_formula_by_hand(kind, zenith, azimuth, sun_zenith, expected):
    value = luminance(kind, direction(zenith, azimuth), direction(sun_zenith, 180.0))
    assert value == pytest.approx(expected, rel=3e-6)


def test_uniform_sky_has_equal_patches():
    L = light(CieSky(5, 10_000.0), sun_at([30.0, 60.0]))
    np.testing.assert_allclose(L.sky[:, 1:], 10_000 / np.pi, rtol=1e-12)
    np.testing.assert_allclose(L.sky[:, 0], 0.2 / np.pi * 10_000, rtol=1e-12)
    assert (L["sun"] == 0).all()


@pytest.mark.parametrize("kind", [*range(1, 17), *cie.GENSKY])
def test_given_illuminance_is_exact(kind):
    L = light(CieSky(kind, 7_654.0), sun_at([3.0, 44.0, 88.0], 77.0))
    illuminance = L.sky.to_numpy()[:, 1:] @ Patches().projected_solid_angles[1:]
    np.testing.assert_allclose(illuminance, 7_654, rtol=1e-12)
    np.testing.assert_allclose(L.diffuse_horizontal_illuminance, 7_654, rtol=1e-12)


def test_overcast_illuminance_is_seven_ninths_of_pi():
    """∫ (1 + 2 z)/3 z dΩ = 7π/9, less the variance of z within each patch: Δz²/12."""
    L = light(CieSky("overcast"), sun_at(40.0))
    zenith = cie.zenith_luminance("overcast", np.cos(np.radians(40.0)))
    patches = Patches()
    low, high = np.sin(patches.bounds[1:, :2]).T
    lost = 2 / 3 * (patches.solid_angles[1:] * (high - low) ** 2 / 12).sum()
    expected = (7 * np.pi / 9 - lost) * zenith
    assert L.diffuse_horizontal_illuminance.item() == pytest.approx(expected, rel=1e-12)
    # 8.6 sin 50° + 0.123 = 6.7110 kcd/m²
    assert zenith == pytest.approx(6711.0 * 179 / 203, rel=1e-4)


@pytest.mark.parametrize("kind", [2, 9, 12, 15, "clear", "intermediate"])
def test_patch_values_are_means_of_the_continuous_sky(kind):
    sun = sun_at(55.0, 131.0)
    L = light(CieSky(kind, 10_000.0), sun).sky.to_numpy()[0, 1:]
    rng = np.random.default_rng(1)
    bounds = Patches().bounds[1:]
    patches = rng.choice(145, 12, replace=False)
    sampled = []
    for low, high, west, east in bounds[patches]:
        z, turn = rng.uniform(np.sin(low), np.sin(high), 20_000), rng.uniform(west, east, 20_000)
        w = direction(np.degrees(np.arccos(z)), np.degrees(turn))
        sampled.append(luminance(kind, w, sun.direction.to_numpy()[0]).mean())
    ratio = L[patches] / sampled
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=0.01)


def test_night_is_black():
    for kind in (*cie.GENSKY, 5, 12):
        L = light(CieSky(kind, None if isinstance(kind, str) else 5000.0), sun_at([90.5, 120.0]))
        assert (L.sky == 0).all()
        assert (L["sun"] == 0).all()


def test_only_skies_with_sun_have_one():
    sun = sun_at([30.0])
    for kind in cie.GENSKY:
        assert (light(CieSky(kind), sun)["sun"].item() > 0) == kind.endswith("with_sun")


@pytest.mark.parametrize("kind", [*range(1, 17), *cie.GENSKY])
@pytest.mark.parametrize("zenith", [0.0, 1.0, 89.9999])
def test_extreme_suns_stay_finite(kind, zenith):
    L = light(CieSky(kind, None if isinstance(kind, str) else 1e4), sun_at(zenith))
    assert np.isfinite(L.sky).all()
    assert (L.sky >= 0).all()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((17, 1e4), "kind"),
        (("foggy",), "kind"),
        ((3,), "diffuse_horizontal_illuminance"),
        ((3, -1.0), "diffuse_horizontal_illuminance"),
        (("clear", float("nan")), "diffuse_horizontal_illuminance"),
        (("clear", None, float("nan")), "turbidity"),
    ],
)
def test_wrong_input_is_refused(arguments, match):
    with pytest.raises(InputError, match=match):
        CieSky(*arguments)


# The program itself, at the edges of what it prints.


def program(name):
    skips.RADIANCE.skip_if_so()
    return home() / "bin" / name


def gensky(kind, altitude, azimuth, turbidity=2.45):
    """Output of `gensky -ang`; azimuth [deg] from the south, west positive."""
    angles = ["-ang", str(altitude), str(azimuth)]
    command = [program("gensky"), *angles, OPTION[kind], "-t", str(turbidity)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    blocks = text.split("void brightfunc")
    numbers = [float(v) for v in re.findall(r"-?\d\.\d+(?:e[+-]\d+)?", blocks[1])]
    sun = re.search(r"^3 (\S+)", blocks[0], re.MULTILINE)
    return text, numbers, float(sun[1]) if sun else 0.0


@pytest.mark.parametrize("kind", cie.GENSKY)
@pytest.mark.parametrize("altitude", [4.0, 9.0, 30.0, 62.0, 86.0])
@pytest.mark.parametrize("turbidity", [2.45, 5.0])
def test_zenith_and_sun_are_those_of_gensky(kind, altitude, turbidity):
    _, (zenith, *_), sun_radiance = gensky(kind, altitude, 20.0, turbidity)
    ours = cie.zenith_luminance(kind, np.sin(np.radians(altitude)), turbidity)
    # Three printed digits.
    assert ours == pytest.approx(179 * zenith, rel=5.1e-3)
    L = light(CieSky(kind, turbidity=turbidity), sun_at(90 - altitude, 200.0))
    assert L["sun"].item() == pytest.approx(179 * sun_radiance, rel=5.1e-4)
    assert L.direct_normal_illuminance.item() == pytest.approx(
        179 * sun_radiance * disk_solid_angle(0.5), rel=5.1e-4
    )


@pytest.mark.parametrize("kind", ["clear", "intermediate", "overcast"])
@pytest.mark.parametrize("altitude", [12.0, 35.0, 70.0])
def test_luminance_is_what_rtrace_sees_of_gensky(kind, altitude, tmp_path):
    text, numbers, _ = gensky(kind, altitude, 20.0)
    zenith, ground = numbers[:2]
    glow = "skyfunc glow skyglow 0 0 4 1 1 1 0\nskyglow source sky 0 0 4 0 0 1 180\n"
    scene, octree = tmp_path / "sky.rad", tmp_path / "sky.oct"
    scene.write_text(text + glow)
    library = program("gensky").parents[1] / "lib"
    environment = {**os.environ, "RAYPATH": f".:{library}"}
    with octree.open("wb") as file:
        subprocess.run(
            [program("oconv"), scene], stdout=file, stderr=subprocess.PIPE, check=True,
            env=environment,
        )  # fmt: skip
    rng = np.random.default_rng(7)
    w = direction(np.degrees(np.arccos(rng.uniform(0.02, 1, 60))), rng.uniform(0, 360, 60))
    rays = "\n".join(f"0 0 0 {x:.9f} {y:.9f} {z:.9f}" for x, y, z in w)
    seen = subprocess.run(
        [program("rtrace"), "-h", "-w", "-ov", octree], input=rays, capture_output=True,
        text=True, check=True, env=environment,
    ).stdout  # fmt: skip
    theirs = np.array([float(line.split()[0]) for line in seen.splitlines()])
    # skybright.cal blends the sky with the ground near the horizon; ours is the sky alone.
    above = (w[:, 2] + 1.01) ** 10
    ours = zenith * luminance(kind, w, direction(90 - altitude, 200.0))
    blended = (above * ours + ground / above) / (above + 1 / above)
    np.testing.assert_allclose(blended, theirs, rtol=1e-3)


def test_patch_centres_are_the_continuous_luminance():
    sun = sun_at(50.0, 120.0)
    L = light(CieSky("clear", patch_values=PatchCentres()), sun).sky.to_numpy()[0, 1:]
    zenith = cie.zenith_luminance("clear", np.cos(np.radians(50.0)))
    d = Patches().directions[1:]
    expected = zenith * luminance("clear", d, sun.direction.to_numpy()[0])
    np.testing.assert_allclose(L, expected, rtol=1e-12)
