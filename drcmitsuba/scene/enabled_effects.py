"""What a simulation follows: the decisions of a plan, as transport reads them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from drcmitsuba.scene.sun_visibility import SunVisibility
from drcmitsuba.sky.sun_models import Suns


@dataclass(frozen=True)
class EnabledEffects:
    """Effects that are simulated; what is out of it is neither loaded nor traced.

    The default follows everything that a scene holds.

    Parameters
    ----------
    sky, ground, suns : bool
        Sources.
    sun_visibility : SunVisibility or None
        Tells which suns get in; None takes all of them.
    clear_panes, scattering_panes, films : bool
        Panes and holes of this kind; black sheets stand in place of the others.
    enclosed : bool
        Rays that would not pass an opening are spared.
    straight_through : bool or None
        Whether films are looked through; None leaves it to each of them.
    components, obstructions : bool
        What deviates light, and furniture outside of the room.
    pane_to_pane : bool
        Photons follow what panes send to each other across the room.
    beyond : bool
        What leaves a room through a pane may come back.
    shade : bool
        The shade may close; else it is left out of the case.
    every_shade : bool
        The shaded state is simulated for all suns, not only for those of hours that close.
    depth : int or None
        Surfaces that a path of the gather meets at most; None: any number.
    channels : bool or None
        Colour channels are simulated one by one; None: where the scene is coloured.
    pictures : bool
    """

    sky: bool = True
    ground: bool = True
    suns: bool = True
    sun_visibility: SunVisibility | None = None
    clear_panes: bool = True
    scattering_panes: bool = True
    films: bool = True
    enclosed: bool = True
    straight_through: bool | None = None
    components: bool = True
    obstructions: bool = True
    pane_to_pane: bool = False
    beyond: bool = True
    shade: bool = True
    every_shade: bool = False
    depth: int | None = None
    channels: bool | None = None
    pictures: bool = True

    def enabled_suns(self, suns: Suns) -> np.ndarray:
        """Which suns are followed, shape (sun,); the coefficients of the others are 0."""
        if not self.suns:
            return np.zeros(len(suns.labels), bool)
        if self.sun_visibility is None or not suns.labels:
            return np.ones(len(suns.labels), bool)
        return self.sun_visibility.visible(suns.directions, suns.diameter).mask

    def shines(self, d: mi.Vector3f) -> mi.Bool:
        """Whether light of sky and ground is wanted that comes from directions."""
        if self.sky and self.ground:
            return mi.Bool(True)
        return d.z >= 0 if self.sky else (d.z < 0) & self.ground

    def to_dict(self) -> dict[str, Any]:
        """Plain values that coefficients follow from, for their fingerprint.

        Not whether suns shine or the shade closes: that the weather decides, and suns or a state
        that another weather needs are added.
        """
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        for name in ("suns", "sun_visibility", "shade", "every_shade", "pictures"):
            del values[name]
        return values


ALL_EFFECTS = EnabledEffects()
"""All that a scene holds."""
