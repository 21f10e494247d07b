r"""Light of a year by bands of the spectrum: melanopic light and colour at sensors and eyes.

    bands, spectra ─ Tints, SourceSpectra ─► materials and L of each band
    for each band  ─ of_points ────────────► C_k of the states of the façade; E_k = C_k·L_k
    E_k            ─ weights ──────────────► responses M = Σ_k w_k E_k

Every band has the same random numbers, so that M' and the illuminance E' of a simulation by
luminance with these numbers differ by colour alone. Their ratio is known far better than either and
needs few rays. With the illuminance E of the evaluation, which has many,

.. math:: M = E \cdot \frac{\overline{M'}}{\overline{E'}},

means over replicates. The states of the façade are those of the evaluation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import of_points
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.colour.appearance import temperatures
from drcmitsuba.colour.bands import ALPHA_OPIC, TRISTIMULUS, Bands
from drcmitsuba.colour.sources import SourceSpectra
from drcmitsuba.colour.tints import Tints
from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.scene.geometry import origin, rotation
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import Tint, untinted
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import sources

MEMORY = 1 << 30
"""Largest size of the responses of a block of points [bytes]."""
FEWER = 4
"""Factor by which each band has fewer rays than an evaluation."""
LARGER = 2.0
"""Factor by which its cells are larger: their size enters M and E' alike."""
REPLICATES = 3
"""Number of independent replicates of each band."""


RAYS = (
    "paths", "cell_paths", "cell_sky_rays", "sensor_sky_rays", "pane_points", "film_sky_samples",
    "photons",
)  # fmt: skip
"""Numbers of rays that a band has fewer of."""


@dataclass(frozen=True)
class _Responses:
    """Responses of the eye at some points, sums over bands [lx, as D65]."""

    luminance: np.ndarray
    """Illuminance of the simulation by luminance, shape (replicate, time, point)."""
    melanopic: np.ndarray
    """Melanopic response, (replicate, time, point)."""
    others: dict[str, np.ndarray]
    """Means of the other responses, (time, point), by name."""
    spectrum: np.ndarray
    """Mean over the time stamps of the light of every band, (band, point)."""

    @property
    def ratio(self) -> tuple[np.ndarray, np.ndarray]:
        """Melanopic response per illuminance and its standard error, (time, point).

        The error follows from the replicates' deviations from the ratio of the means.
        """
        ratio = self._per_luminance(self.melanopic.mean(axis=0))
        mean = np.maximum(self.luminance.mean(axis=0), 1e-9)
        apart = (self.melanopic - ratio * self.luminance) / mean
        return ratio, apart.std(axis=0, ddof=1) / np.sqrt(len(apart))

    def per_luminance(self, name: str) -> np.ndarray:
        """Another response per illuminance, (time, point)."""
        return self._per_luminance(self.others[name])

    def _per_luminance(self, response: np.ndarray) -> np.ndarray:
        """Response (time, point) per illuminance; an hour of which no ray tells has the mean."""
        E = self.luminance.mean(axis=0)
        lit, total = E > 0, E.sum(axis=0)
        usual = np.divide(response.sum(axis=0), total, out=np.ones_like(total), where=total > 0)
        return np.where(lit, response / np.where(lit, E, 1), usual)


@dataclass(frozen=True)
class _BandLight:
    """Simulation of points by luminance, or in a band."""

    case: Case
    light: Daylight
    taken: FacadeStates
    run: Run
    tints: Tints
    spectra: SourceSpectra

    def in_band(
        self, band: int | None, points: np.ndarray, normals: np.ndarray, progress: Progress
    ) -> np.ndarray:
        """E of each replicate in a band, or by luminance [lx], (replicate, time, point)."""
        few = self.case.with_tables(accuracy=band_accuracy(self.case.accuracy, len(points)))
        light = replace(self, case=few)
        if band is None:
            return light.illuminance(self.light.sky, untinted, points, normals, progress)
        sky = self.spectra.of_band(self.light.sky, band, self.tints.ground(band))
        tint = partial(self.tints.of, band)
        return light.illuminance(sky, tint, points, normals, progress)

    def illuminance(
        self, sky: xr.Dataset, tint: Tint, points: np.ndarray, normals: np.ndarray,
        progress: Progress,
    ) -> np.ndarray:  # fmt: skip
        """E of each replicate under a sky with tinted surfaces [lx], (replicate, time, point)."""
        E, hours = None, np.bincount(self.taken.index, minlength=len(self.taken.states))
        ends = np.r_[0, hours.cumsum()] / hours.sum()
        for i, state in enumerate(self.taken.states):
            if not hours[i]:
                continue
            here = np.flatnonzero(self.taken.index == i)
            some = sky.isel(time=here)
            suns = self.light.suns.only(sources(some.isel(time=some["sun"].values > 0)))
            C = of_points(
                self.case, state, suns, sky.attrs["latitude"], points, normals, run=self.run,
                tint=tint, progress=part(progress, ends[i], ends[i + 1]),
            )  # fmt: skip
            of_state = accumulate.replicates(C, some, np.arange(len(points)))
            if E is None:
                E = np.zeros((len(of_state), sky.sizes["time"], len(points)), np.float32)
            E[:, here] = of_state
        assert E is not None
        return E

    def responses(self, points: np.ndarray, normals: np.ndarray, progress: Progress) -> _Responses:
        """Responses of the eye at points (point, 3) [m] with their unit normals."""
        bands = self.tints.bands
        names = [name for name in (*TRISTIMULUS, *ALPHA_OPIC) if name != "melanopic"]
        weights = {name: bands.weights(name) for name in (*names, "melanopic")}
        ends = np.linspace(0, 1, len(bands) + 2)
        luminance = self.in_band(None, points, normals, part(progress, *ends[:2]))
        melanopic = np.zeros_like(luminance)
        others = {name: np.zeros(luminance.shape[1:], np.float32) for name in names}
        spectrum = np.empty((len(bands), len(points)))
        for k in range(len(bands)):
            E = self.in_band(k, points, normals, part(progress, *ends[k + 1 : k + 3]))
            melanopic += np.float32(weights["melanopic"][k]) * E
            mean = E.mean(axis=0)
            spectrum[k] = mean.mean(axis=0)
            for name, total in others.items():
                total += np.float32(weights[name][k]) * mean
        return _Responses(luminance, melanopic, others, spectrum)


def band_accuracy(accuracy: Accuracy, points: int) -> Accuracy:
    """Accuracy of a band at so many points: rays as a ratio needs them."""
    few = with_few_rays(accuracy.of_points(points), REPLICATES)
    return few.model_copy(update={"cell_size": LARGER * few.cell_size, "target": None})


def with_few_rays(accuracy: Accuracy, replicates: int) -> Accuracy:
    """Accuracy with a part of the rays, in so many replicates."""
    fewer = {name: max(1, getattr(accuracy, name) // FEWER) for name in RAYS}
    return accuracy.model_copy(update=fewer | {"replicates": replicates})


def spectral_year(
    case: Case, light: Daylight, E: xr.Dataset, taken: FacadeStates, run: Run,
) -> xr.Dataset:  # fmt: skip
    """Melanopic light and colour at the sensors and views of a case, hour by hour.

    Parameters
    ----------
    case : Case
        Case with `colour.bands` of 9 or 27.
    light : Daylight
        Its time stamps are those of E.
    E : xr.Dataset
        `total` and `total_se` (time, sensor) [lx] of the evaluation by luminance.
    taken : FacadeStates
        State of the façade at every time stamp.
    run : Run
        Seed, effects and stages.

    Returns
    -------
    xr.Dataset
        Dims (time, sensor): `melanopic` and `melanopic_se`, `s_cone_opic`, `m_cone_opic`,
        `l_cone_opic`, `rhodopic`, all equivalent daylight illuminances [lx]; `chromaticity_x`,
        `chromaticity_y` (CIE 1931), `cct` [K] and `duv` [–]. Dims (wavelength, sensor): `spectrum`,
        mean light of the time stamps per that of D65. With views the same, and their
        `illuminance`, with `_at_views` in the name and dims (time, view), (wavelength, view).

    Raises
    ------
    InputError
        A spectrum is unfit, or no surface has its name.
    """
    bands = Bands.of(case.colour.wavelengths)
    tints = Tints(case, bands)
    with run.timed("spectra of the sky"):
        spectra = SourceSpectra.of(case, light.alone(), bands)
    seed = case_seed(run.seed, Stream.COLOUR)
    effects = replace(run.enabled_effects, channels=False)
    alone = replace(run, seed=seed, enabled_effects=effects, blocks=None, elsewhere=None)
    of_band = _BandLight(case, light, taken, alone, tints, spectra)
    points, normals = prepared(case).receivers.at()
    per_point = 4 * light.sky.sizes["time"] * (3 * REPLICATES + 10)
    step = max(1, MEMORY // per_point)
    parts = []
    with run.timed(f"{len(bands)} bands") as done:
        for start in range(0, len(points), step):
            here = slice(start, start + step)
            end = min(start + step, len(points))
            share = part(done, start / len(points), end / len(points))
            seen = of_band.responses(points[here], normals[here], share)
            total, error = (E[name].values[:, here] for name in ("total", "total_se"))
            parts.append(_arrays(seen, total, error, "sensor"))
    out = xr.concat(parts, "sensor") if len(parts) > 1 else parts[0]
    eyes = _eyes(case)
    if len(eyes[0]):
        out = out.merge(_at_views(of_band, run, *eyes))
    of_sensors = {str(k): c.variable for k, c in E.coords.items() if c.dims == ("sensor",)}
    out = out.assign_coords(
        time=light.sky["time"], wavelength=("wavelength", list(bands.wavelengths)), **of_sensors
    )
    out.attrs = {
        "interval_factor": E.attrs["interval_factor"], "sky_colour": str(case.colour.sky),
        "sun_colour": str(case.colour.sun),
    }  # fmt: skip
    return schema.describe(out)


def _eyes(case: Case) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Places [m] and directions of the views in the traced frame, (view, 3) each, and names."""
    views, turn = prepared(case).views, rotation(case)
    if not views:
        return np.zeros((0, 3)), np.zeros((0, 3)), []
    positions = np.array([view.position for view in views]) - origin(case)
    ahead = np.array([view.direction for view in views], float)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return positions @ turn.T, ahead @ turn.T, [view.name for view in views]


def _at_views(
    of_band: _BandLight, run: Run, points: np.ndarray, forward: np.ndarray,
    names: list[str],
) -> xr.Dataset:  # fmt: skip
    """Arrays at the views: their illuminance is simulated with all rays of the case."""
    effects = replace(run.enabled_effects, channels=False, solved_cells=False)
    whole = replace(of_band, run=replace(of_band.run, seed=run.seed, enabled_effects=effects))
    with run.timed("views") as done:
        of_half = part(done, 0.0, 0.5)
        E = whole.illuminance(of_band.light.sky, untinted, points, forward, of_half)
        total, error = schema.mean_and_error(E)
        seen = of_band.responses(points, forward, part(done, 0.5, 1.0))
    made = _arrays(seen, total, error, "view").assign(
        illuminance=(("time", "view"), total), illuminance_se=(("time", "view"), error)
    )
    made = made.rename({name: _of_views(str(name)) for name in made.data_vars})
    return made.assign_coords(view=np.array(names, dtype=object))


def _of_views(name: str) -> str:
    """Name of an array at views."""
    return f"{name.removesuffix('_se')}_at_views" + ("_se" if name.endswith("_se") else "")


def _arrays(seen: _Responses, total: np.ndarray, error: np.ndarray, dim: str) -> xr.Dataset:
    """Responses of the light at points, from their illuminance and its standard error [lx]."""
    ratio, of_ratio = seen.ratio
    dims = ("time", dim)
    X, Y, Z = (seen.per_luminance(name) for name in TRISTIMULUS)
    white = np.array([0.95047, 1.0, 1.08883])  # of D65, to which bands are relative
    tristimulus = np.stack([X, Y, Z]) * white[:, None, None]
    whole = np.maximum(tristimulus.sum(axis=0), 1e-12)
    x, y = (part / whole for part in tristimulus[:2])
    dark = ~(total > 0)  # light has no colour there
    cct, duv = temperatures(np.where(dark, 0, x), np.where(dark, 0, y))
    arrays = {
        "melanopic": total * ratio,
        "melanopic_se": np.hypot(total * of_ratio, error * ratio),
        **{name: total * seen.per_luminance(name) for name in ALPHA_OPIC if name != "melanopic"},
        "chromaticity_x": x,
        "chromaticity_y": y,
        "cct": cct,
        "duv": duv,
    }
    data = xr.Dataset({name: (dims, a.astype(np.float32)) for name, a in arrays.items()})
    spectrum = seen.spectrum / np.maximum(seen.luminance.mean(axis=(0, 1)), 1e-9)
    return data.assign(spectrum=(("wavelength", dim), spectrum.astype(np.float32)))
