"""Spectra of the sky's patches, the sun and the ground, by time stamp, relative to D65.

A patch of the sky is a phase of daylight (CIE 015) of a colour temperature that follows from its
luminance. The models are of clear skies; overcast skies have one temperature, and between them the
reciprocal temperature is interpolated by the logarithm of Perez's clearness.

References
----------
.. [1] C. Chain, D. Dumortier, M. Fontoynont, "A comprehensive model of luminance, correlated colour
   temperature and spectral distribution of skylight: comparison with experimental data", Solar
   Energy 65 (5), 1999, 285-295.
.. [2] H. Takagi et al., "Relationship between luminance and color temperature of sky", 1990, as in
   A. K. Diakite-Kortlever, M. Knoop, "Forecast accuracy of existing luminance-related spectral sky
   models", Lighting Research & Technology 53 (7), 2021, 657-676.
.. [3] R. E. Bird, C. Riordan, "Simple solar spectral model for direct and diffuse irradiance on
   horizontal and tilted planes", Journal of Climate and Applied Meteorology 25, 1986, 87-97.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.case import Case
from drcmitsuba.case.sky import CieTable
from drcmitsuba.colour.bands import GRID, PHOTOPIC, Bands, responses
from drcmitsuba.colour.spectra import read_spectrum
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.daylight import Daylight

colour = lazy.module("colour")

COLDEST, HOTTEST = 4000.0, 25_000.0
"""Colour temperatures between which phases of daylight are defined [K]."""
OVERCAST = 6514.0
"""Colour temperature of overcast skies [K]; [2]."""
CLEAR = 6.2
"""Perez's clearness from which on a sky counts as clear [–], the edge of his last bin."""
MIREDS = np.linspace(1e6 / HOTTEST, 1e6 / COLDEST, 64)
"""Reciprocal temperatures of a table [1/MK]."""
TURBIDITIES = np.geomspace(0.01, 0.5, 12)
"""Optical depths of aerosol at 500 nm [–]; a sun that is dimmer still shines through cloud, which
is grey."""
AIR_MASSES = np.geomspace(1.0, 38.0, 24)
"""Relative air masses [–]."""
LARGEST = 1e12
"""Largest power of a source at a wavelength, in any unit."""
OZONE, PRESSURE, WATER = 0.31, 101_325.0, 1.5
"""Ozone [atm·cm], pressure [Pa] and precipitable water [cm] of a usual atmosphere: water absorbs
little light that one sees."""


@dataclass(frozen=True)
class SourceSpectra:
    """Light of each band per light of all, by source: 1 lx is so many lx in a band."""

    sky: np.ndarray
    """Reciprocal temperature of the ground, as 0, and of the patches [1/MK], shape (time, bin)."""
    sun: np.ndarray
    """Light of the sun, shape (band, time)."""
    ground: np.ndarray
    """Light on open ground, shape (band, time)."""
    phases: np.ndarray
    """Light of the sky with reciprocal temperatures `MIREDS`, shape (band, temperature): of phases
    of daylight, or of one measured spectrum."""

    @classmethod
    def of(cls, case: Case, light: Daylight, bands: Bands) -> SourceSpectra:
        """Spectra of a case's sources at its time stamps."""
        phases = bands.relative(GRID, daylight_phases())
        mireds, of_sun = 1e6 / sky_temperatures(case, light), case.colour.sun
        if of_sun == "spectrl2":
            sun = bands.relative(GRID, sun_spectra(light).T)
        else:
            if isinstance(of_sun, Path):
                one = _measured(of_sun, bands)
            else:
                one = np.array([[np.interp(1e6 / float(of_sun), MIREDS, row)] for row in phases])
            sun = np.repeat(one, len(mireds), axis=1)
        if isinstance(case.colour.sky, Path):
            phases = np.repeat(_measured(case.colour.sky, bands), len(MIREDS), axis=1)
        L, patches = light.sky["sky"].values[:, 1:], Patches(case.sky.subdivision)
        on_ground = L * patches.projected_solid_angles[1:]
        z = np.maximum(light.sky["sun_direction"].values[:, 2], 0)
        by_sun = light.sky["direct_normal_illuminance"].values * z
        each = [(on_ground * np.interp(mireds, MIREDS, row)).sum(axis=1) for row in phases]
        total = np.maximum(on_ground.sum(axis=1) + by_sun, 1e-9)
        ground = (np.stack(each) + by_sun * sun) / total
        return cls(np.pad(mireds, ((0, 0), (1, 0))), sun, ground, phases)

    def of_band(self, sky: xr.Dataset, band: int, ground: float = 1.0) -> xr.Dataset:
        """Sky and sun of a band [cd/m², as D65], where the ground reflects `ground` × as much."""
        share = np.empty(self.sky.shape, np.float32)
        share[:, 1:] = self.of_phase(band, self.sky[:, 1:])
        share[:, 0] = self.ground[band] * ground
        return sky.assign(sky=sky["sky"] * share, sun=sky["sun"] * self.sun[band])

    def of_phase(self, band: int, mireds: np.ndarray) -> np.ndarray:
        """Light of a band in phases of daylight of reciprocal temperatures [1/MK], any shape."""
        return np.interp(mireds, MIREDS, self.phases[band])


def _measured(path: Path, bands: Bands) -> np.ndarray:
    """Light of bands of a source whose spectrum a file holds, shape (band, 1)."""
    measured = read_spectrum(path, bands, most=LARGEST)
    power = measured.values[:, :1]
    if not bands.weights("Y") @ bands.sampled(measured.wavelengths, power) > 0:
        got = "no visible light at the wavelengths of the bands"
        raise InputError(path, "values", got, "give the power by wavelength, as wide as a band")
    return bands.relative(measured.wavelengths, power)


def check_sources(case: Case, bands: Bands) -> None:
    """Refuse unfit files of the sources' spectra before any light is traced."""
    for path in (case.colour.sky, case.colour.sun):
        if isinstance(path, Path):
            _measured(path, bands)


@lru_cache(maxsize=1)
def daylight_phases() -> np.ndarray:
    """Relative spectra of phases of daylight with `MIREDS` on `GRID`, shape (wavelength, phase)."""
    shape = colour.SpectralShape(GRID[0], GRID[-1], GRID[1] - GRID[0])
    make = colour.sd_CIE_illuminant_D_series
    chromaticities = colour.temperature.CCT_to_xy_CIE_D(1e6 / MIREDS)
    each = [make(xy, M1_M2_rounding=False, shape=shape).values for xy in chromaticities]
    return np.stack(each, axis=1)


def sky_temperatures(case: Case, light: Daylight, L: np.ndarray | None = None) -> np.ndarray:
    """Correlated colour temperature of the sky [K], shape (time, place).

    The luminances L (time, place) [cd/m²] are those of its patches unless others are given.

    `chain` is [1]_, 10⁶ / (59.77 log₁₀ L − 132.1); `takagi` is [2]_, 6500 + 1.1985·10⁸ / L^1.2,
    with the luminance L [cd/m²].
    """
    L = np.maximum(light.sky["sky"].values[:, 1:] if L is None else L, 1.0)
    if isinstance(case.colour.sky, Path):
        return np.full(L.shape, OVERCAST)  # its spectrum does not depend on it
    if not isinstance(case.colour.sky, str):
        return np.full(L.shape, float(case.colour.sky))
    if case.colour.sky == "chain":
        mireds = 59.77 * np.log10(L) - 132.1
    else:
        mireds = 1e6 / (6500 + 1.1985e8 / L**1.2)
    clear = clearness(case, light)[:, None]
    mireds = clear * np.clip(mireds, MIREDS[0], MIREDS[-1]) + (1 - clear) * 1e6 / OVERCAST
    return np.asarray(1e6 / mireds)


def clearness(case: Case, light: Daylight) -> np.ndarray:
    """How clear the sky is, from 0, overcast, to 1, shape (time,).

    Skies of ISO 15469 have it by their type, others by Perez's ε, of illuminances.
    """
    if isinstance(case.sky, CieTable):
        kind = case.sky.type
        if isinstance(kind, str):
            of_type = 0.0 if kind == "overcast" else 1.0 if kind.startswith("clear") else 0.5
        else:
            of_type = 0.0 if kind <= 5 or kind == 16 else 0.5 if kind <= 10 else 1.0
        return np.full(light.sky.sizes["time"], of_type)
    direct = light.sky["direct_normal_illuminance"].values
    diffuse = np.maximum(light.sky["diffuse_horizontal_illuminance"].values, 1e-3)
    zenith = np.radians(np.clip(light.sun["solar_zenith"].values, 0, 90))
    epsilon = 1 + direct / diffuse / (1 + 1.041 * zenith**3)
    return np.clip(np.log(epsilon) / np.log(CLEAR), 0, 1)


def sun_spectra(light: Daylight) -> np.ndarray:
    """Relative spectra of the sun at each time stamp on `GRID`, shape (time, wavelength).

    The model is [3]_; its turbidity is the one that gives the direct normal illuminance.
    """
    from pvlib.atmosphere import get_relative_airmass

    spectra = _by_air_mass_and_turbidity()
    E = PHOTOPIC * (spectra @ responses()["Y"]) * (GRID[1] - GRID[0])
    zenith = np.minimum(light.sun["solar_zenith"].values, 89.9)
    mass = np.clip(get_relative_airmass(zenith), AIR_MASSES[0], AIR_MASSES[-1])
    place = np.interp(np.log(mass), np.log(AIR_MASSES), np.arange(len(AIR_MASSES)))
    low = np.minimum(place.astype(int), len(AIR_MASSES) - 2)
    share = (place - low)[:, None]
    of_mass = E[low] * (1 - share) + E[low + 1] * share  # (time, turbidity), falling
    wanted = light.sky["direct_normal_illuminance"].values
    log_depth = np.array(
        [np.interp(-e, -row, np.arange(len(row))) for e, row in zip(wanted, of_mass, strict=True)]
    )
    thin = np.minimum(log_depth.astype(int), len(TURBIDITIES) - 2)
    rest = (log_depth - thin)[:, None]
    out = np.zeros((len(mass), len(GRID)))
    for i, along in ((low, 1 - share), (low + 1, share)):
        for j, across in ((thin, 1 - rest), (thin + 1, rest)):
            out += along * across * spectra[i, j]
    return out


@lru_cache(maxsize=1)
def _by_air_mass_and_turbidity() -> np.ndarray:
    """Direct normal spectra [W/(m² nm)], shape (air mass, turbidity, wavelength)."""
    from pvlib.spectrum import spectrl2

    mass, depth = (x.ravel() for x in np.meshgrid(AIR_MASSES, TURBIDITIES, indexing="ij"))
    zenith = np.degrees(np.arccos(np.clip(1 / mass, 0.01, 1)))  # enters by the ground's light only
    day = np.full(len(mass), 94)  # the earth is at its mean distance
    given = spectrl2(
        zenith, zenith, 0, 0.2, PRESSURE, mass, WATER, OZONE, depth, dayofyear=day
    )  # fmt: skip
    at = given["wavelength"]
    rows = [np.interp(GRID, at, column) for column in given["dni"].T]
    return np.reshape(rows, (len(AIR_MASSES), len(TURBIDITIES), len(GRID)))
