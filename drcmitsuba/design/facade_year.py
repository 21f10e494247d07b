"""A searched façade under the sky of a period: illuminance by any composition, with gradients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.cut_tiles import CutTiles
from drcmitsuba.design.facade_glare import TracedEyes
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.design.facade_tiles import TiledLight, Tiles
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.schema import channel_weights
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.smooth_states import SmoothStates
from drcmitsuba.transport.elements.smooth_year import SmoothYear
from drcmitsuba.transport.elements.state_illuminances import Illuminances, weighed
from drcmitsuba.transport.elements.straight_pairs import StraightPairs


@dataclass(frozen=True)
class FacadeYear:
    """Light by tile and material under the sky of a period."""

    tiles: Tiles
    materials: tuple[str, ...]
    """Names of the materials, the columns of a composition."""
    names: tuple[str, ...]
    """Material of every element, "" for light that passes no tile."""
    still: mi.Float
    """Shares of the elements of other sides, the shade open; 1 for light that passes no tile."""
    channels: tuple[tuple[float, SmoothYear | SmoothStates], ...]
    """Weight in luminance and year of every colour channel; one of a grey case."""
    place: mi.Int32 | None = None
    """Place of every element in a composition, −1 where it is `still`; None where those of the
    searched façade come first."""
    groups: FacadeGroups | None = None
    """Groups of panes that close one by one; None where one shade closes."""
    daylight: Daylight | None = None
    """Daylight that the year is of; None where no standard asks for its hours."""
    eyes: TracedEyes | None = None
    """Eyes, and all that they see; None where hours of glare are not asked for."""
    cut: CutTiles | None = None
    """Tiles as they are built; None where they are built as they are mixed."""

    @classmethod
    def of(
        cls, tiled: TiledLight, daylight: Daylight, eyes: TracedEyes | None = None
    ) -> FacadeYear:
        """Put light by tile under the daylight of a case; errors are those of `SmoothYear.of`."""
        how = daylight, tiled.is_open, tiled.closings, tiled.group
        years: list[SmoothYear | SmoothStates] = [
            SmoothStates.of(lights, *how) if len({*map(id, lights)}) > 1
            else SmoothYear.of(lights[0], *how)
            for lights in zip(*map(tiled.standing, range(1 + len(tiled.closings))), strict=True)
        ]  # fmt: skip
        weights = channel_weights(len(years))
        still, names = flat(np.append(tiled.as_drawn, 1)), (*tiled.names, "")
        channels = tuple(zip(weights, years, strict=True))
        place = None if tiled.place is None else mi.Int32(np.append(tiled.place, -1))
        parts = tiled.tiles, tiled.materials, names, still, channels, place, tiled.groups
        return cls(*parts, daylight, eyes)

    @property
    def months(self) -> np.ndarray:
        """Month of each time stamp, 1 to 12, int, shape (time,)."""
        return self.channels[0][1].months

    @property
    def step_hours(self) -> float:
        """Duration of a time step [h]."""
        return self.channels[0][1].step_hours

    def at(self, hours: np.ndarray) -> FacadeYear:
        """Year of some time stamps (hour,), each of which stands for several."""
        groups = None if self.groups is None else self.groups.at(hours)
        eyes = None if self.eyes is None else self.eyes.at(hours)
        channels = tuple((weight, year.at(hours)) for weight, year in self.channels)
        return replace(self, channels=channels, groups=groups, daylight=None, eyes=eyes)

    def illuminance(
        self, share: mi.TensorXf, scale: Mapping[str, mi.Float] | None = None
    ) -> Illuminances:
        """Illuminance by a composition.

        Parameters
        ----------
        share : mi.TensorXf, shape (tile, material)
            Shares of the tiles' area, the shade open; rows sum to 1. Gradients flow through.
        scale : dict, optional
            Factors of the light that comes in by a material, in all sides, by default 1. Light
            that the material sends back into the room keeps its weight.

        Returns
        -------
        Illuminances
            E [lx]; of a coloured case by its luminance.

        Raises
        ------
        InputError
            No tile can have a material of `scale`.
        """
        shares, factors = self.weights(share, scale)
        return weighed((w, year.illuminance(shares, factors)) for w, year in self.channels)

    def with_cut_tiles(self, cut: CutTiles) -> FacadeYear:
        """Year whose tiles are cut into panes where they are built."""
        channels = tuple((w, year.with_straight(cut.passed)) for w, year in self.channels)
        return replace(self, channels=channels, cut=cut)

    def built(
        self, share: mi.TensorXf, E: Illuminances, scale: Mapping[str, mi.Float] | None = None
    ) -> Illuminances:
        """Illuminance of a composition with straight sun as by its tiles when they are built.

        `E` [lx] is that of `illuminance`; it keeps what is no straight sun of the open state.
        """
        if self.cut is None:
            return E
        shares, factors = self.weights(share, scale)
        low, high = map(flat, self.cut.spans(share.numpy()))

        def through_strips(pairs: StraightPairs) -> mi.Float:
            own = pairs.between(low, high, shares)
            return pairs.summed(own * dr.gather(mi.Float, factors, pairs.element))

        parts = [[w * E for E in year.straight_sun(through_strips)] for w, year in self.channels]
        direct, *by_group = map(sum, zip(*parts, strict=True))
        return E._replace(direct=direct, by_group=tuple(by_group))

    def weights(
        self, share: mi.TensorXf, scale: Mapping[str, mi.Float] | None = None
    ) -> tuple[mi.Float, mi.Float]:
        """Shares and factors of all elements, (element + 1,) each; arguments as `illuminance`."""
        factors = self._factors(scale or {})
        if self.place is None:
            return dr.concat((share.array, self.still)), factors
        at, here = mi.UInt32(dr.maximum(self.place, 0)), self.place >= 0
        shares = dr.select(here, dr.gather(mi.Float, share.array, at, here), self.still)
        return shares, factors

    def _factors(self, scale: Mapping[str, mi.Float]) -> mi.Float:
        """Factor of the light of every element, and 1."""
        factors = dr.ones(mi.Float, len(self.names))
        for name, value in scale.items():
            if not name or name not in self.names:
                known = ", ".join(dict.fromkeys(filter(None, self.names)))
                raise InputError("design", "scale", f"no material {name!r}", f"choose of {known}")
            factors = dr.select(mi.Bool([own == name for own in self.names]), value, factors)
        return factors
