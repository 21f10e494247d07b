"""One state of the façade: illuminance at the eyes, and what is seen from each of their places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import of_points
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.place import PlaceInFacade, seen_places
from drcmitsuba.glare_year.seen import SeenSurfaces
from drcmitsuba.glare_year.surface_light import LightRows
from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.scene import scene
from drcmitsuba.schema import by_luminance
from drcmitsuba.sky.daylight import Daylight

COEFFICIENTS = 20 << 20
"""Largest number of coefficients of surfaces in one replicate that are in memory at once."""
SKY_RAYS = 512
"""Largest number of rays to the sky of a surface's point in a replicate: many make a source."""
SUN_SAMPLES = 2
"""Largest number of directions in each replicate from a surface to a sun that an edge crosses, or
that a mirror shows: a tile stands for a piece of the surface, of which it knows one point."""


def at_eyes(case: Case, state: State, light: Daylight, looking: Eyes, run: Run) -> np.ndarray:
    """Vertical illuminance at the eyes by each replicate of C [lx], (replicate, time, view).

    Eyes are few and turned to one side each: paths of all bounces cost them no more than cells,
    which lend the light of one side of a room to the other by as much as the noise that is left.
    """
    with run.timed(f"eyes, {state}") as done:
        C = of_points(
            case, state, light.suns, light.sky.attrs["latitude"], looking.points, looking.forward,
            run=on_paths(run), progress=done,
        )  # fmt: skip
        return accumulate.replicates(by_luminance(C), light.sky, np.arange(len(looking)))


def on_paths(run: Run) -> Run:
    """Run whose light between surfaces is followed on paths."""
    return replace(run, enabled_effects=replace(run.enabled_effects, solved_cells=False))


def places(
    case: Case, state: State, light: Daylight, looking: Eyes, run: Run, least: float = 0.0
) -> Iterator[PlaceInFacade]:
    """Trace what is seen from each place in one state of the façade, place by place.

    Parameters
    ----------
    case : Case
    state : str
        State of the façade, see `case.groups`.
    light : Daylight
    looking : Eyes
    run : Run
    least : float
        As of `seen_places`.

    Yields
    ------
    PlaceInFacade
        Its arrays take 10 to 60 kB for every time stamp, the most where it looks at films.
    """
    world = scene.load(case, state, -1, run.enabled_effects)

    def tracer(surfaces: SeenSurfaces, replicates: int, again: bool) -> _InState:
        own = again_with(run) if again else run
        coarse = coarser(case, replicates)
        C = of_points(
            coarse, state, light.suns, light.sky.attrs["latitude"], surfaces.points,
            surfaces.normals, run=replace(own, shared=None),  # these points are of this call alone
        )  # fmt: skip
        return _InState(C, light.sky, surfaces)

    alone = np.zeros((light.sky.sizes["time"], 0))
    for place in seen_places(
        case, [world], None, LightRows(), tracer, light, looking, run, least=least,
        coefficients=COEFFICIENTS,
    ):  # fmt: skip
        yield place.in_facade(alone)


def again_with(run: Run) -> Run:
    """Run whose further replicates of bright surfaces have random numbers of their own."""
    return replace(run, seed=case_seed(run.seed, Stream.BRIGHT_SURFACES))


def coarser(case: Case, replicates: int) -> Case:
    """Case with so many replicates, and less effort for a point of a surface than sensors have."""
    accuracy = case.accuracy
    fewer = {
        "replicates": replicates,
        "sensor_sky_rays": min(SKY_RAYS, accuracy.sensor_sky_rays),
        "sensor_sun_samples": min(SUN_SAMPLES, accuracy.sensor_sun_samples),
        "mirrored_sun_samples": 0,  # of faint mirrors, not to every sun
    }
    return case.with_tables(accuracy=accuracy.model_copy(update=fewer))


@dataclass(frozen=True, eq=False)
class _InState:
    """Luminances of surfaces from coefficients of one state; see `TracedSurfaces`."""

    C: xr.Dataset
    sky: xr.Dataset
    surfaces: SeenSurfaces

    @cached_property
    def _channels(self) -> list[xr.Dataset]:
        coloured = "channel" in self.C.dims
        return [self.C.isel(channel=k) for k in range(3)] if coloured else [self.C]

    def mean(self) -> np.ndarray:
        """Mean over the replicates [cd/m²], shape (1, point, time)."""
        of_mean = []
        for C in self._channels:
            mean = C["replicates"].mean("replicate", skipna=False).expand_dims("replicate")
            of_mean.append(C.drop_vars("replicates").assign(replicates=mean))
        return self._luminance(of_mean, np.arange(len(self.surfaces.points)))[:, 0]

    def each(self, points: np.ndarray) -> np.ndarray:
        """Luminance by each replicate [cd/m²], shape (1, replicate, point, time)."""
        return self._luminance(self._channels, points)

    def _luminance(self, channels: list[xr.Dataset], points: np.ndarray) -> np.ndarray:
        E = np.stack([accumulate.replicates(one, self.sky, points) for one in channels])
        taken = self.surfaces.take(points)
        of_replicates = (taken.luminance(E[:, r].swapaxes(1, 2)) for r in range(E.shape[1]))
        return np.stack([*of_replicates])[None]
