"""A façade of known elements in its daylight: what stays, what moves, and the light of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual.choice import ChosenFills
from drcmitsuba.annual.moving_groups import MovingGroups, moving_groups
from drcmitsuba.annual.simulation import joined_channels
from drcmitsuba.annual.summed_year import luminances_of, replicates_of
from drcmitsuba.annual.weighed_year import WeighedYear
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, GroupStates, State
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.machine_memory import of_machine
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import Member, PaneGroups
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import blended
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements import LightByElement, compute
from drcmitsuba.transport.elements.known_year import KnownYear
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight
from drcmitsuba.transport.elements.simulate import MOST_BYTES
from drcmitsuba.transport.elements.trace import Points
from drcmitsuba.transport.elements.weights import different_rows
from drcmitsuba.transport.elements.year_by_bin import YearByBin


def light_of_channels(
    case: Case, panes: PaneGroups, suns: Suns, accuracy: Accuracy, effects: EnabledEffects,
    progress: Progress, kept: int | None = None, receivers: Points | None = None,
) -> tuple[LightByElement, ...]:  # fmt: skip
    """Light by element of every colour channel of a case; one of a grey case.

    Arguments and errors are those of `transport.elements.compute`.
    """
    numbers = scene.channels_of(case, effects)
    return tuple(
        compute(
            case, panes, suns, accuracy, effects, channel=number, kept=kept,
            receivers=receivers, most_bytes=MOST_BYTES // len(numbers),
            progress=part(progress, i / len(numbers), (i + 1) / len(numbers)),
        )
        for i, number in enumerate(numbers)
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class KnownLight:
    """Light by element in a case's daylight, which all of its façades share."""

    years: tuple[KnownYear, ...] | tuple[YearByBin, ...]
    """Year of the case's own time stamps, of every colour channel."""
    suns: np.ndarray
    """Suns that shine in the whole year, positions among all bins, int, shape (sun,)."""

    @property
    def bright(self) -> np.ndarray:
        """Ground, sky, and suns of the case's own time stamps, positions among all bins, int."""
        light, L = self.years[0].light, self.years[0].L
        suns = np.flatnonzero(L[:, light.sky_bins :].getnnz(axis=0))
        return np.concatenate([np.arange(light.sky_bins), light.sky_bins + suns])

    @property
    def summed(self) -> KnownYear | None:
        """Year by element of which E is a plain sum; None in colour, and where G_m differs."""
        year, *others = self.years
        if isinstance(year, KnownYear) and not (others or year.differs):
            return year
        return None

    @classmethod
    def of(cls, channels: tuple[LightByElement, ...], daylight: Daylight) -> KnownLight | None:
        """Sum the light of every element hour by hour; None where memory does not hold it."""
        light, hours = channels[0], daylight.sky.sizes["time"]
        size = sum(each.nbytes + KnownYear.nbytes(each, hours) for each in channels)
        if size > min(MOST_BYTES, of_machine()):
            return None
        L = luminances_of(daylight, light.labels)
        years = tuple(KnownYear.of(each, L) for each in channels)
        return cls(years, suns_of(daylight, light))

    @classmethod
    def by_bin(cls, channels: tuple[AnyLight, ...], daylight: Daylight) -> KnownLight:
        """Light that few façades take, each of which sums it by its own bins."""
        L = luminances_of(daylight, channels[0].labels)
        years = tuple(YearByBin(each, L) for each in channels)
        return cls(years, suns_of(daylight, channels[0]))


def suns_of(daylight: Daylight, light: AnyLight) -> np.ndarray:
    """Bins that stand for the suns that shine in the whole year, int, shape (bin,).

    They are positions among all bins in rising order; patches of the sky may be among them.
    """
    every, blend = luminances_of(daylight.every, light.labels), blended(daylight.every.sky)
    suns = light.sky_bins + np.flatnonzero(every[:, light.sky_bins :].getnnz(axis=0))
    sky = np.array(light.labels[: light.sky_bins], object)
    return np.concatenate([np.flatnonzero(np.isin(sky, blend.bins[blend.weights > 0])), suns])


@dataclass(frozen=True, eq=False)
class ChosenFacade:
    """A façade of known elements: a `StateSource` of the states that its groups take."""

    case: Case
    openings: GroupStates
    channels: tuple[AnyLight, ...]
    still: np.ndarray
    """Shares of all elements where no group moves, shape (element,)."""
    moving: MovingGroups
    attributes: dict[str, Any]
    """Attributes of C: origin, groups, rule and schedules."""
    light: KnownLight | None = None
    """Light in the case's daylight, where it is known."""
    factors: np.ndarray | float = 1.0
    """Factors of the light by every element, shape (element,)."""
    sky: xr.Dataset | None = None
    """Hours and their suns, where fills are chosen by the hour."""

    @classmethod
    def of(
        cls, case: Case, panes: PaneGroups, channels: tuple[AnyLight, ...],
        marked: Mapping[str, Any], time: xr.DataArray, chosen: ChosenFills,
        drawn: Mapping[int, np.ndarray], members: Mapping[int, Member] | None = None,
        light: KnownLight | None = None, factors: np.ndarray | float = 1.0,
        sky: xr.Dataset | None = None,
    ) -> ChosenFacade:  # fmt: skip
        """Put a choice on a case, whose C has the attributes `marked`.

        Other arguments are as for `moving_groups`.
        """
        starts = panes.states.starts
        still = np.zeros(starts[-1], np.float32)
        still[list(starts[:-1])] = 1
        for g, row in {**drawn, **chosen.constant}.items():
            still[starts[g] : starts[g + 1]] = row
        moving = moving_groups(case, panes, chosen, drawn, time, members)
        marked = dict(marked)
        for name in ("groups", "schedule", "shade_threshold", "shade_area"):
            marked.pop(name, None)
        marked["has_shade"] = int(bool(moving.groups))
        # Glare has a façade without light on sensors.
        if pairs := max((light.pairs.left_out for light in channels), default=0):
            marked["pairs_left_out"] = pairs
        if moving.groups:
            threshold, area = case.shade_rule
            marked |= {"shade_threshold": threshold, "shade_area": area}
            marked |= moving.states.attributes() | moving.schedule.attributes()
        tables = [group.parts for group in moving.groups]
        marked["fingerprint"] = str(content_key(marked["fingerprint"], still * factors, tables))
        sky = sky if chosen.hourly else None
        return cls(case, panes.states, channels, still, moving, marked, light, factors, sky)

    def shares(self, indices: np.ndarray) -> np.ndarray:
        """Shares of all elements (…, element), from the state of every group (…, group)."""
        return self.moving.shares(self.still, indices) * self.factors

    def scheduled(self, daylight: Daylight) -> np.ndarray:
        """Shares of all elements (row, element) in a year whose rules close nothing."""
        indices = self.moving.schedule.indices(daylight.sky["time"])
        return self.shares(np.unique(indices, axis=0))

    def state(self, state: State, labels: np.ndarray | None, progress: Progress) -> xr.Dataset:
        """C [sr] of a state for all suns; see `StateSource`."""
        shares = self._shares_of(state)
        C = joined_channels([each.coefficients(shares) for each in self._standing(shares)])
        C = self._with_sensors(C)
        progress(1)
        return self._with_suns_by_hour(self._with_group_of_sun(C, shares)) if state == OPEN else C

    def _with_suns_by_hour(self, C: xr.Dataset) -> xr.Dataset:
        """C of the open state, whose suns come straight by the fills of their hours."""
        if self.sky is None:
            return C
        labels, blend = np.array(self.channels[0].labels, object), blended(self.sky)
        suns = np.flatnonzero(np.isin(labels, blend.bins[blend.weights > 0]))
        if not len(suns):
            return C
        own = self.straight(suns)
        rest = C[list(own.data_vars)].drop_sel(bin=own["bin"])
        own = own.drop_vars(set(own.coords) - {"bin"})  # those of the sensors are in the rest
        how: dict[str, Any] = {"join": "exact", "coords": "minimal", "compat": "override"}
        by_hour = xr.concat([rest, own], "bin", **how).sel(bin=C["bin"])
        return C.assign(dict(by_hour.data_vars))

    def straight(self, suns: np.ndarray) -> xr.Dataset:
        """Straight part of C with all shades open [sr], of some suns (sun,), positions among bins.

        Each sun comes through what a choice has in the hours that it stands for; where this
        differs, in most of them.
        """
        rows, row = self._shares_at(suns)
        parts = [self._straight(shares, suns[row == k]) for k, shares in enumerate(rows)]
        if len(parts) == 1:
            return parts[0]
        labels = np.array(self.channels[0].labels, dtype=object)[suns]
        return xr.concat(parts, "bin", join="exact").sel(bin=labels)

    def _shares_at(self, suns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Different shares (row, element) with all shades open, and the row of every sun."""
        if self.sky is None or not len(suns):
            return self._shares_of(OPEN)[None], np.zeros(len(suns), int)
        time, blend = self.sky["time"], blended(self.sky)
        rows, of_hour = different_rows(self.shares(self.moving.drawn_at(time)), len(time))
        names = {self.channels[0].labels[sun]: k for k, sun in enumerate(suns.tolist())}
        count = np.zeros((len(suns), len(rows)))
        for hour, which in zip(*np.nonzero(blend.weights > 0), strict=True):
            if (sun := names.get(str(blend.bins[hour, which]))) is not None:
                count[sun, of_hour[hour]] += blend.weights[hour, which]
        row = count.argmax(axis=1)
        used, row = np.unique(row, return_inverse=True)
        return rows[used], row

    def _straight(self, shares: np.ndarray, suns: np.ndarray) -> xr.Dataset:
        channels = []
        labels = np.array(self.channels[0].labels, dtype=object)[suns]
        for each in self._standing(shares):
            both = zip(("straight", "straight_se"), each.straight(shares, suns), strict=True)
            arrays = {name: (("sensor", "bin"), values.T) for name, values in both}
            channels.append(xr.Dataset(arrays, {"bin": labels}))
        C = self._with_sensors(joined_channels(channels))
        return self._with_group_of_sun(C, shares, suns)

    def replicates(self, indices: np.ndarray) -> xr.Dataset:
        """`replicates` of C [sr] with the groups in states (group,).

        Where light is known, C has the bins that are bright in its daylight.
        """
        shares, bins = self.shares(indices), np.arange(len(self.channels[0].labels))
        bins = bins if self.light is None else self.light.bright
        C = joined_channels([each.replicates_at(shares, bins) for each in self._standing(shares)])
        return self._with_sensors(C).assign_attrs(self.attributes)

    def known(
        self, daylight: Daylight, state: State, hours: np.ndarray | None = None
    ) -> xr.Dataset:
        """`illuminance` [lx] of a state at all or some time stamps, where the `light` is known."""
        assert self.light is not None
        shares, time = self._shares_of(state), daylight.sky["time"].values
        if (summed := self.light.summed) is not None:
            return self._summed(daylight, WeighedYear.constant(summed, shares))
        channels = [year.illuminance(shares, hours) for year in self.light.years]
        held = _by_channel(channels, time if hours is None else time[hours])
        return self._with_sensors(xr.Dataset({"illuminance": held}, attrs=self.attributes))

    def year(
        self, daylight: Daylight, indices: np.ndarray, progress: Progress = lambda share: None
    ) -> xr.Dataset:
        """`illuminance` [lx] of a year; see `StateSource`."""
        if self.light is not None and (summed := self.light.summed) is not None:
            rows, row = different_rows(self.shares(indices), len(indices))
            return self._summed(daylight, WeighedYear(summed, rows, row))
        return xr.Dataset({"illuminance": self.illuminance(daylight, self.shares(indices))})

    def illuminance(self, daylight: Daylight, shares: np.ndarray) -> xr.DataArray:
        """E (replicate, time, sensor) [lx] of shares (time, element), by channel where coloured."""
        if self.light is not None:
            known = [year.illuminance(shares) for year in self.light.years]
            return _by_channel(known, daylight.sky["time"].values)
        L = luminances_of(daylight, self.channels[0].labels)
        years = [light.illuminance(L, shares) for light in self.channels]
        return replicates_of(daylight, years, self.channels[0].replicates)

    def _summed(self, daylight: Daylight, year: WeighedYear) -> xr.Dataset:
        """`illuminance` [lx] that is summed where it is asked for."""
        E = xr.Variable(("replicate", "time", "sensor"), year)
        time = {"time": daylight.sky["time"].values}
        return self._with_sensors(xr.Dataset({"illuminance": E}, time, self.attributes))

    def _shares_of(self, state: State) -> np.ndarray:
        """Shares of all elements (element,) in a state of the groups."""
        return self.shares(np.array(self.moving.states.indices(state), int))

    def _standing(self, shares: np.ndarray) -> tuple[LightByElement, ...]:
        """Light of every channel by the surfaces that stand with shares (element,)."""
        return tuple(each.standing(shares) for each in self.channels)

    def _with_sensors(self, data: xr.Dataset) -> xr.Dataset:
        """Arrays with the coordinates of the sensors."""
        return data.assign_coords(prepared(self.case).receivers.coordinates.coords)

    def _with_group_of_sun(
        self, C: xr.Dataset, shares: np.ndarray, bins: np.ndarray | None = None
    ) -> xr.Dataset:
        """Add `pane_group` (sensor, bin), by which most of a sun comes straight, −1 for none.

        `bins` are the positions of the bins of C among all of them, where these are some.
        """
        groups, starts = self.moving.states, self.openings.starts
        if not self.moving.groups or len(groups) < 2:
            return C
        every = range(len(starts) - 1)
        group = np.repeat(list(map(self.moving.number_of, every)), np.diff(starts))
        out = group_of_sun(self._standing(shares), shares, group, len(groups), bins)
        return C.assign(pane_group=(("sensor", "bin"), out))


def group_of_sun(
    channels: tuple[LightByElement, ...], shares: np.ndarray, group: np.ndarray, count: int,
    bins: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Group of panes by which most of each sun comes straight, −1 for none, (sensor, bin).

    Parameters
    ----------
    channels : tuple of LightByElement
        Light of every colour channel; green stands for all colours.
    shares : np.ndarray, shape (element,)
        Shares of all elements while every group is open.
    group : np.ndarray of int, shape (element,)
        Number of every element's group, less than `count`; −1 for none.
    bins : np.ndarray of int, optional
        Positions of some bins among all of them; by default all.
    """
    light = channels[1 if len(channels) > 1 else 0]
    bins = np.arange(len(light.labels)) if bins is None else bins
    out = np.full((len(light.positions), len(bins)), -1, np.float32)
    most = np.zeros(out.shape, np.float32)
    for k in range(count):
        straight = np.zeros_like(most)
        for e in np.flatnonzero((group == k) & (shares != 0)):
            places, straight_of = light.elements[e].seen_at(bins)
            at, sensor = np.divmod(places, len(straight))
            straight[sensor, at] += shares[e] * straight_of.mean(axis=0)
        out[straight > most] = k
        most = np.maximum(most, straight)
    return out


def _by_channel(channels: list[np.ndarray], time: np.ndarray) -> xr.DataArray:
    """E (replicate, time, sensor) [lx] of all channels, with a dim where the case is coloured."""
    dims = ("replicate", "time", "sensor")
    if len(channels) == 1:
        return xr.DataArray(channels[0], {"time": time}, dims)
    names = np.array(list(LUMINANCE_WEIGHTS), dtype=object)
    return xr.DataArray(np.stack(channels), {"channel": names, "time": time}, ("channel", *dims))
