"""Coefficients by group of panes and state, from which E of any states, hour by hour, is a sum."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, HIDDEN, GroupStates
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.metrics.bin_luminances import source_luminances
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part, silent
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.schema import LUMINANCE_WEIGHTS, describe, mean_and_error
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.transport import group_basis

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

ENTRIES = 1 << 24
"""Number of pairs of sensors and time stamps whose illuminance is summed at once."""


@dataclass(frozen=True)
class GroupCoefficients:
    """Coefficients by group and state of a case in its daylight.

    Parameters
    ----------
    daylight : Daylight
    channels : tuple of GroupBasis
        Basis of every colour channel; one of a grey case.
    """

    daylight: Daylight
    channels: tuple[group_basis.GroupBasis, ...]

    @classmethod
    def of(
        cls, case: Case, daylight: Daylight, run: Run, progress: Progress = lambda share: None
    ) -> GroupCoefficients:
        """Simulate every group in every state, for all suns.

        Raises
        ------
        InputError
            The case has no groups, an adaptive sun or a target, or is too large.
        """
        accuracy, effects = _accuracy(case, run), run.enabled_effects
        channels = scene.channels_of(case, effects)
        made = [
            group_basis.compute(
                case, daylight.suns, accuracy, effects, channel=channel,
                progress=part(progress, i / len(channels), (i + 1) / len(channels)),
            )
            for i, channel in enumerate(channels)
        ]  # fmt: skip
        return cls(daylight, tuple(made))

    @property
    def groups(self) -> GroupStates:
        """Names of the groups and of their states."""
        return self.channels[0].groups

    def replicates(self, indices: np.ndarray) -> xr.DataArray:
        """Illuminance by each replicate.

        Parameters
        ----------
        indices : np.ndarray of int, shape (time, group)
            State of every group at every time stamp, an index.

        Returns
        -------
        xr.DataArray, dims (replicate, time, sensor), `channel` first where the case is coloured
            E [lx].
        """
        years = [self._years(basis, indices) for basis in self.channels]
        return _replicates(self.daylight, years, self.channels[0].replicates)

    def _years(self, basis: group_basis.GroupBasis, indices: np.ndarray) -> Iterator[np.ndarray]:
        return basis.illuminance(_luminances(self.daylight, basis.labels), indices)

    def illuminance(self, states: np.ndarray | xr.DataArray) -> xr.Dataset:
        """Illuminance with the groups in given states.

        Parameters
        ----------
        states : np.ndarray or DataArray, shape (time, group)
            Name or index of the state of every group at every time stamp.

        Returns
        -------
        xr.Dataset
            `total`, `total_se` (time, sensor) [lx].

        Raises
        ------
        InputError
            Another shape, or an unknown state.
        """
        given = np.asarray(states)
        shape = (self.daylight.sky.sizes["time"], len(self.groups))
        if given.shape != shape:
            got = f"the shape {given.shape}"
            raise InputError("states", "shape", got, f"give {shape}: time stamps and groups")
        indices = given if given.dtype.kind in "iu" else self._named(given)
        if (indices < 0).any() or (indices > np.array(self.groups.last)).any():
            got = "an index out of range"
            raise InputError("states", "index", got, f"at most {self.groups.last}")
        E = self.replicates(indices)
        mean, error = mean_and_error(E.transpose("replicate", ...).values)
        dims = [dim for dim in E.dims if dim != "replicate"]
        out = {"total": (dims, mean), "total_se": (dims, error)}
        points = self.channels[0].positions
        at = {axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")}
        return describe(xr.Dataset(out, {**E.coords, **at}))

    def _named(self, names: np.ndarray) -> np.ndarray:
        """Indices of states by name, (time, group)."""
        out = np.zeros(names.shape, int)
        for g, known in enumerate(self.groups.states):
            for name in np.unique(names[:, g]):
                if str(name) not in known:
                    got = f"no state {str(name)!r}"
                    remedy = f"choose one of {', '.join(known)}"
                    raise InputError("states", self.groups.names[g], got, remedy)
                out[names[:, g] == name, g] = known.index(str(name))
        return out


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
        Sensors, and their `illuminance` by each replicate [lx], as from
        `GroupCoefficients.replicates`. The run stores each block before it is yielded.

    Raises
    ------
    InputError
        As for `GroupCoefficients.of`.
    """
    accuracy, effects = _accuracy(case, run), run.enabled_effects
    points, normals = sensor_points(case)
    channels = scene.channels_of(case, effects)
    groups, labels = PaneGroups.of(case).states, Patches(case.sky.subdivision).labels
    L = _luminances(daylight, (*labels, *daylight.suns.labels))
    year = group_basis.Year.of(L, np.array(groups.starts[:-1]) + indices, len(labels))
    content = () if run.blocks is None else _content(case, groups, effects, channels)
    size = max(1, ENTRIES // len(indices))
    for start in range(0, len(points), size):
        here = slice(start, min(start + size, len(points)))
        done = part(progress, here.start / len(points), here.stop / len(points))
        # A block's random numbers are its own.
        its = accuracy.model_copy(update={"seed": accuracy.seed + start})

        def made(its: Accuracy = its, here: slice = here, done: Progress = done) -> xr.Dataset:
            years = [
                group_basis.illuminance(
                    case, daylight.suns, its, effects, year, channel=channel, sensors=here,
                    progress=part(done, i / len(channels), (i + 1) / len(channels)),
                )
                for i, channel in enumerate(channels)
            ]  # fmt: skip
            return xr.Dataset({"illuminance": _replicates(daylight, years, its.replicates)})

        kept = run.kept(
            f"{case.name}, year of states", content, points[here], normals[here], its.sampling,
            case.sky.subdivision, daylight.suns, L.data, L.indices, L.indptr, indices,
        )  # fmt: skip
        yield here, kept.kept(here.stop - here.start, made)


def _content(
    case: Case, groups: GroupStates, effects: EnabledEffects, channels: Sequence[int]
) -> tuple[Any, ...]:
    """Everything that the light of every group in every state depends on in a case's scenes."""
    states = [(g, s) for g, of in enumerate(groups.states) for s in range(len(of))]
    labels = [
        groups.label([state if g == group else BLOCKED for g in range(len(groups))])
        for group, state in [(-1, BLOCKED), *states]
    ]
    labels.append(groups.label([HIDDEN] * len(groups)))
    return tuple(
        scene.load(case, label, channel, effects).content
        for channel in channels
        for label in labels
    )


def _accuracy(case: Case, run: Run) -> Accuracy:
    """Samples of a sum over groups, which has neither an adaptive sun nor a target."""
    if isinstance(case.sun, Adaptive):
        got = "adaptive, where groups of panes are simulated one by one"
        raise InputError(case.source, "sun.model", got, "take another one, or fewer states")
    if case.accuracy.sensor_goal is not None:
        got = "a target, where groups of panes are simulated one by one"
        raise InputError(case.source, "accuracy.target", got, "leave it out")
    return run.accuracy(case, len(sensor_points(case)[0]))


def _luminances(daylight: Daylight, labels: Sequence[str]) -> csr_matrix:
    """Luminances (time, bin) [cd/m²] of bins by their labels."""
    known = xr.Dataset(coords={"bin": np.array(labels, dtype=object)})
    return source_luminances(known, daylight.sky)


def _replicates(
    daylight: Daylight, channels: list[Iterator[np.ndarray]], replicates: int
) -> xr.DataArray:
    """Illuminances [lx] of all replicates and channels."""
    values = np.zeros((0,))
    for i, years in enumerate(channels):
        for r, year in enumerate(years):  # one by one: a list would hold them twice
            if not values.size:
                values = np.empty((len(channels), replicates, *year.shape), np.float32)
            values[i, r] = year
    dims = ("channel", "replicate", "time", "sensor")
    out = xr.DataArray(values, dims=dims, coords={"time": daylight.sky["time"]})
    if len(channels) == 1:
        return out.isel(channel=0)
    return out.assign_coords(channel=np.array(list(LUMINANCE_WEIGHTS), dtype=object))


def group_coefficients(case: Case | str | Path, stage: Stage = silent) -> GroupCoefficients:
    """Simulate every group of panes of a case in every state.

    Parameters
    ----------
    case : Case, str or Path
        Case with `[groups]`, or with a shade and windows on several sides.
    stage : callable, optional
        Function that shows the stages of the work.

    Returns
    -------
    GroupCoefficients

    Raises
    ------
    InputError
        The case has no groups, an adaptive sun or a target, or is too large.
    """
    case = case if isinstance(case, Case) else load_case(case)
    backend.select()
    run = replace(Run.of(case), stage=stage)
    with run.timed("sky"):
        light = daylight(case)
        run = replace(run, enabled_effects=plan(case, light).scope)
    with run.timed("groups of panes") as done:
        return GroupCoefficients.of(case, light, run, done)
