"""Standard CIE skies: the sixteen of ISO 15469, and the clear, intermediate, overcast of gensky.

References
----------
.. [1] ISO 15469:2004 / CIE S 011, "Spatial distribution of daylight – CIE standard general sky".
.. [2] CIE Technical Committee 4.2, "Standardization of luminance distribution on clear skies",
   CIE publication 22, 1973; overcast: P. Moon, D. Spencer, 1942; intermediate: K. Matsuura, 1987.
.. [3] Radiance, `gensky.c` and `skybright.cal` (zenith luminance after Krochmann).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import sun as sun_module
from drcmitsuba.sky.quadrature import PATCH_MEANS, LuminanceAt, PatchValues, SkyLight, scale_to

ISO_15469 = np.array(
    [
        [4, -0.7, 0, -1, 0],
        [4, -0.7, 2, -1.5, 0.15],
        [1.1, -0.8, 0, -1, 0],
        [1.1, -0.8, 2, -1.5, 0.15],
        [0, -1, 0, -1, 0],
        [0, -1, 2, -1.5, 0.15],
        [0, -1, 5, -2.5, 0.3],
        [0, -1, 10, -3, 0.45],
        [-1, -0.55, 2, -1.5, 0.15],
        [-1, -0.55, 5, -2.5, 0.3],
        [-1, -0.55, 10, -3, 0.45],
        [-1, -0.32, 10, -3, 0.45],
        [-1, -0.32, 16, -3, 0.3],
        [-1, -0.15, 16, -3, 0.3],
        [-1, -0.15, 24, -2.8, 0.15],
    ]
)
"""a, b, c, d, e of the types 1 to 15 [1]_; type 16 is the traditional overcast sky."""

GENSKY = ("clear", "clear_with_sun", "intermediate", "intermediate_with_sun", "overcast")
"""Skies of Radiance's gensky: -s, +s, -i, +i, -c."""
HIGHEST_SUN = 87.0
"""Altitude [deg] up to which gensky's clear and intermediate skies are defined."""
WHITE_EFFICACY, SKY_EFFICACY, SUN_EFFICACY = 179.0, 203.0, 208.0
"""Radiance's lm/W of white, sky and sun light. gensky turns kcd/m² into radiance by the last two,
every Radiance program turns radiance back by the first."""
GENSKY_SUN_SOLID_ANGLE = 4 * np.pi * np.sin(np.radians(0.5) / 4) ** 2
"""Solid angle of gensky's sun, a disc of 0.5° [sr]."""


@dataclass(frozen=True)
class CieSky:
    """A standard sky at every time; it depends on the sun's position, not on the weather.

    Parameters
    ----------
    kind : int or str
        Type 1 to 16 of ISO 15469, or one of GENSKY.
    diffuse_horizontal_illuminance : float, optional
        Diffuse horizontal illuminance while the sun is up [lx]. ISO types need it; gensky's skies
        have a zenith luminance of their own without it.
    turbidity : float
        Linke turbidity of gensky's clear and intermediate skies.
    patch_values : PatchMeans or PatchCentres
        How the continuous sky becomes one luminance per patch.

    Raises
    ------
    InputError
        For an unknown kind, an ISO type without an illuminance, or a turbidity outside 1 to 20.

    Notes
    -----
    Luminances are gensky's radiances [W/m²/sr] times 179 lm/W: what Radiance shows. As gensky
    divides by 203 (sky) and 208 lm/W (sun), they are 0.88 and 0.86 of the kcd/m² in the
    formulas. Where the sun's centre is below the horizon the sky is black. gensky's blend of sky
    and ground within some degrees of the horizon is left out.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> from drcmitsuba import sky
    >>> weather = drcmitsuba.weather.default()
    >>> times = np.array(["2015-03-20T09", "2015-03-20T12"], "datetime64[ns]")
    >>> sun = sky.sun_position(times, 1.0, weather.site)
    >>> L = sky.radiance(weather.data.sel(time=times), sun, model=sky.CieSky("overcast"))
    >>> bool((L["sky"] > 0).all())
    True
    """

    kind: int | str
    diffuse_horizontal_illuminance: float | None = None
    turbidity: float = 2.45
    patch_values: PatchValues = PATCH_MEANS

    def __post_init__(self) -> None:
        if self.kind not in (*range(1, 17), *GENSKY):
            remedy = f"give a type from 1 to 16, or one of {', '.join(GENSKY)}"
            raise InputError("CIE sky", "kind", repr(self.kind), remedy)
        given = self.diffuse_horizontal_illuminance
        if given is None and not isinstance(self.kind, str):
            remedy = "give it in lx: ISO 15469 has no absolute luminance"
            raise InputError("CIE sky", "diffuse_horizontal_illuminance", "nothing", remedy)
        if given is not None and not 0 <= given < np.inf:
            remedy = "give a number of lx from 0"
            raise InputError("CIE sky", "diffuse_horizontal_illuminance", str(given), remedy)
        if not 1 <= self.turbidity <= 20:
            raise InputError("CIE sky", "turbidity", str(self.turbidity), "give 1 to 20")

    def luminances(self, data: xr.Dataset, sun: xr.Dataset, patches: Patches) -> SkyLight:
        """Sky and direct light of each time, as `SkyModel` says."""
        zenith, azimuth = (sun[name].to_numpy() for name in ("solar_zenith", "solar_azimuth"))
        up = np.flatnonzero(zenith < 90)
        direct = np.zeros(len(zenith))
        count, zenith = len(zenith), zenith[up]
        if isinstance(self.kind, str) and self.kind != "overcast":
            zenith = np.maximum(zenith, 90 - HIGHEST_SUN)
        cos_sun = np.cos(np.radians(zenith))

        def luminance(time: mi.UInt32) -> LuminanceAt:
            of_time = dr.gather(mi.Float64, mi.Float64(cos_sun), time)
            return partial(_relative, self.kind, cos_sun=of_time)

        centre = sun_module.direction(zenith, azimuth[up])
        values = self.patch_values(luminance, centre, patches)
        horizontal = self.patch_values.horizontal(patches)
        sky = np.zeros((count, len(horizontal)))
        if self.diffuse_horizontal_illuminance is None:
            sky[up] = values * zenith_luminance(str(self.kind), cos_sun[:, None], self.turbidity)
        else:
            illuminance = np.full(len(up), float(self.diffuse_horizontal_illuminance))
            sky[up] = scale_to(values, illuminance, horizontal)
        direct[up] = direct_normal_illuminance(self.kind, cos_sun)
        return SkyLight(sky, sky @ horizontal, direct)


def relative(
    kind: int | str, cos_zenith: np.ndarray, cos_gamma: np.ndarray, cos_sun: np.ndarray
) -> np.ndarray:
    """Luminance over that of the zenith, L / Lz, shape of the cosines, which broadcast.

    They are cosines of the angles to the zenith, ζ, and to the sun, γ, and of the sun's zenith
    angle Zs. Directions below the horizon are taken as on it. `kind` is that of `CieSky`.

    ISO types: f(γ) φ(ζ) / (f(Zs) φ(0)), φ = 1 + a exp(b / cos ζ),
    f = 1 + c (exp(dγ) − exp(dπ/2)) + e cos² γ.
    """
    cosines = np.broadcast_arrays(cos_zenith, cos_gamma, cos_sun)
    backend.select()
    out = _relative(kind, *(mi.Float64(c.ravel()) for c in cosines))
    return np.asarray(out.numpy().reshape(cosines[0].shape))


def _relative(
    kind: int | str, cos_zenith: mi.Float64, cos_gamma: mi.Float64, cos_sun: mi.Float64
) -> mi.Float64:
    """Do as `relative`, in a kernel."""
    # At this cosine exp(b / cos ζ) with b < 0 has vanished already; 0 would divide by 0.
    cos_zenith = dr.maximum(cos_zenith, 1e-6)
    gamma, sun_zenith = (dr.acos(dr.clip(c, -1, 1)) for c in (cos_gamma, cos_sun))
    if kind in (16, "overcast"):
        return (1 + 2 * cos_zenith + 0 * cos_gamma) / 3
    if kind in ("clear", "clear_with_sun"):
        glow = 0.91 + 10 * dr.exp(-3 * gamma) + 0.45 * cos_gamma**2
        glow_at_zenith = 0.91 + 10 * dr.exp(-3 * sun_zenith) + 0.45 * cos_sun**2
        return glow * (1 - dr.exp(-0.32 / cos_zenith)) / (glow_at_zenith * 0.274)
    if kind in ("intermediate", "intermediate_with_sun"):
        return _intermediate(dr.acos(dr.clip(cos_zenith, -1, 1)), gamma, sun_zenith)
    a, b, c, d, e = map(float, ISO_15469[int(kind) - 1])

    def indicatrix(angle: mi.Float64, cosine: mi.Float64) -> mi.Float64:
        return 1 + c * (dr.exp(d * angle) - math.exp(d * math.pi / 2)) + e * cosine**2

    gradation = (1 + a * dr.exp(b / cos_zenith)) / (1 + a * math.exp(b))
    return gradation * indicatrix(gamma, cos_gamma) / indicatrix(sun_zenith, cos_sun)


def zenith_luminance(kind: str, cos_sun: np.ndarray, turbidity: float = 2.45) -> np.ndarray:
    """Zenith luminance of gensky [cd/m²], 179 lm/W times its radiance.

    Overcast 8.6 sin h + 0.123 kcd/m²; clear (1.376 T − 1.81) tan h + 0.38 kcd/m² with turbidity T;
    intermediate their mean; h the sun's altitude, `cos_sun` = sin h.
    """
    luminance = 8.6 * cos_sun + 0.123
    if kind != "overcast":
        tan_altitude = cos_sun / np.sqrt(1 - cos_sun**2)
        clear = (1.376 * turbidity - 1.81) * tan_altitude + 0.38
        luminance = clear if kind.startswith("clear") else (clear + luminance) / 2
    return np.maximum(luminance, 0) * 1000 * WHITE_EFFICACY / SKY_EFFICACY


def direct_normal_illuminance(kind: int | str, cos_sun: np.ndarray) -> np.ndarray:
    """Direct normal illuminance of gensky's sun [lx]; 0 for a kind without a sun.

    1.5e9 cd/m² (1.147 − 0.147 / max(sin h, 0.16)), 15 % of it under an intermediate sky; h the
    sun's altitude, `cos_sun` = sin h > 0.
    """
    strength = {"clear_with_sun": 1.0, "intermediate_with_sun": 0.15}.get(str(kind), 0.0)
    luminance = 1.5e9 * (1.147 - 0.147 / np.maximum(cos_sun, 0.16))
    return strength * luminance * GENSKY_SUN_SOLID_ANGLE * WHITE_EFFICACY / SUN_EFFICACY


def _intermediate(zenith: mi.Float64, gamma: mi.Float64, sun: mi.Float64) -> mi.Float64:
    """L / Lz of the intermediate sky, angles [rad]; constants of skybright.cal."""

    def absolute(zenith: mi.Float64, gamma: mi.Float64) -> mi.Float64:
        gradation = (1.35 * dr.sin(5.631 - 3.59 * zenith) + 3.12) * dr.sin(4.396 - 2.6 * sun)
        glow = dr.exp(-0.563 * gamma * ((2.629 - zenith) * (1.562 - sun) + 0.812))
        return (gradation + 6.37 - zenith) / 2.326 * glow

    # gensky's own rounding of the value at the zenith, where γ is the sun's zenith angle.
    altitude = math.pi / 2 - sun
    at_zenith = (2.739 + 0.9891 * dr.sin(0.3119 + 2.6 * altitude)) * dr.exp(
        -sun * (0.4441 + 1.48 * altitude)
    )
    return absolute(zenith, gamma) / at_zenith
