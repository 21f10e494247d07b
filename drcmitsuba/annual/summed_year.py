"""Years whose façade takes more states than are simulated one by one: E by sums over elements."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, HIDDEN
from drcmitsuba.metrics.bin_luminances import source_luminances
from drcmitsuba.plan import Plan, plan
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.fills import Fills, effects_of, openings_of
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import by_surfaces
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport import elements

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

ENTRIES = 1 << 24
"""Number of pairs of sensors and time stamps whose illuminance is summed at once."""


def years_of_states(
    case: Case, daylight: Daylight, indices: np.ndarray, run: Run,
    progress: Progress = lambda share: None,
) -> Iterator[tuple[slice, xr.Dataset]]:  # fmt: skip
    """Yield a year of known states of the groups for blocks of sensors; no coefficients are kept.

    Parameters
    ----------
    indices : np.ndarray of int, shape (time, group)
        State of every group at every time stamp, an index.

    Yields
    ------
    slice, xr.Dataset
        Sensors, and their `illuminance` by each replicate [lx]. The run stores each block before
        it is yielded.

    Raises
    ------
    InputError
        As `elements.illuminance`.

    Notes
    -----
    True suns take the place of an adaptive one, and a target adds no rounds: both follow the light
    of one façade.
    """
    case, daylight = case.with_true_suns(), daylight.with_true_suns()
    points, normals = prepared(case).receivers.at()
    accuracy, effects = run.accuracy(case, len(points)), run.enabled_effects
    channels = scene.channels_of(case, effects)
    labels = Patches(case.sky.subdivision).labels
    L = luminances_of(daylight, (*labels, *daylight.suns.labels))
    parts = by_surfaces(case, prepared(case).groups, indices)
    *first, count = prepared(case).groups.states.starts
    shares = elements.chosen(np.array(first), indices, count)
    years = [elements.Year.of(L[hours], shares[hours], len(labels)) for _, hours in parts]
    content = () if run.blocks is None else tuple(
        of for openings, _ in parts for of in _content(case, openings, effects, channels)
    )  # fmt: skip
    size = max(1, ENTRIES // len(indices))
    for start in range(0, len(points), size):
        here = slice(start, min(start + size, len(points)))
        done = part(progress, here.start / len(points), here.stop / len(points))
        # A block's random numbers are its own.
        its = accuracy.model_copy(update={"seed": accuracy.seed + start})

        def made(its: Accuracy = its, here: slice = here, done: Progress = done) -> xr.Dataset:
            shape = len(channels), its.replicates, len(indices), here.stop - here.start
            E, jobs = np.empty(shape, np.float32), len(channels) * len(parts)
            each = itertools.product(enumerate(channels), zip(parts, years, strict=True))
            for i, ((number, channel), ((openings, hours), year)) in enumerate(each):
                summed = elements.illuminance(
                    case, openings, daylight.suns, its, effects, year, channel=channel,
                    receivers=(points[here], normals[here]),
                    progress=part(done, i / jobs, (i + 1) / jobs),
                )  # fmt: skip
                for r, values in enumerate(summed):
                    E[number, r, hours] = values
            return xr.Dataset({"illuminance": by_replicate(E, daylight)})

        kept = run.kept(
            f"{case.name}, year of states", content, points[here], normals[here], its.sampling,
            case.sky.subdivision, daylight.suns, L.data, L.indices, L.indptr, indices,
        )  # fmt: skip
        yield here, kept.kept(here.stop - here.start, made)


def _content(
    case: Case, openings: PaneGroups, effects: EnabledEffects, channels: Sequence[int]
) -> tuple[Any, ...]:
    """Everything that the light of every opening with every fill depends on in a case's scenes."""
    groups = openings.states
    with_panes = [g for g, facings in enumerate(openings.facings) if facings]
    fills = [(g, s) for g in with_panes for s in range(len(groups.states[g]))]
    labels = [
        groups.label([fill if g == opening else BLOCKED for g in range(len(groups))])
        for opening, fill in [(-1, BLOCKED), *fills]
    ]
    labels.append(groups.label([HIDDEN] * len(groups)))
    return tuple(
        scene.load(case, label, channel, effects, openings).content
        for channel in channels
        for label in labels
    )


class Opened(NamedTuple):
    """Openings of a case with their fills, and what is simulated of them."""

    panes: PaneGroups
    planned: Plan
    run: Run

    @classmethod
    def of(
        cls, case: Case, fills: Fills, light: Daylight, run: Run, eyes: np.ndarray | None = None
    ) -> Opened:
        """Open a case whose light is to be summed; errors are those of `openings_of`.

        `eyes` are as for `plan`.
        """
        planned, panes = plan(case, light, eyes), openings_of(case, fills)
        scope = effects_of(panes, planned.scope, case)
        return cls(panes, replace(planned, scope=scope), replace(run, enabled_effects=scope))


def luminances_of(daylight: Daylight, labels: Sequence[str]) -> csr_matrix:
    """Luminances (time, bin) [cd/m²] of bins by their labels."""
    known = xr.Dataset(coords={"bin": np.array(labels, dtype=object)})
    return source_luminances(known, daylight.sky)


def replicates_of(
    daylight: Daylight, channels: list[Iterator[np.ndarray]], replicates: int
) -> xr.DataArray:
    """Illuminances [lx] of all replicates and channels."""
    values = np.zeros((0,))
    for i, years in enumerate(channels):
        for r, year in enumerate(years):  # one by one: a list would hold them twice
            if not values.size:
                values = np.empty((len(channels), replicates, *year.shape), np.float32)
            values[i, r] = year
    return by_replicate(values, daylight)


def by_replicate(values: np.ndarray, daylight: Daylight) -> xr.DataArray:
    """Illuminances [lx], (channel, replicate, time, sensor), with their dims and coordinates."""
    dims = ("channel", "replicate", "time", "sensor")
    out = xr.DataArray(values, dims=dims, coords={"time": daylight.sky["time"]})
    if len(values) == 1:
        return out.isel(channel=0)
    return out.assign_coords(channel=np.array(list(LUMINANCE_WEIGHTS), dtype=object))
