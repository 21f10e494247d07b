"""Effects that a simulation includes: the decisions of a plan for transport."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mitsuba as mi
import numpy as np

from drcmitsuba.case.sun import Sun, ThreePhase
from drcmitsuba.scene.sun_visibility import SunVisibility
from drcmitsuba.sky.sun_models import Suns


@dataclass(frozen=True)
class EnabledEffects:
    """Effects that are simulated; the others are neither loaded nor traced.

    The default enables everything that a scene holds.
    """

    sky: bool = True
    ground: bool = True
    suns: bool = True
    """Whether each source of light shines."""
    sun_visibility: SunVisibility | None = None
    """Geometry that decides which suns light the room; None takes all of them."""
    clear_panes: bool = True
    scattering_panes: bool = True
    films: bool = True
    """Whether light passes panes and holes of a kind; a disabled kind becomes black sheets."""
    enclosed: bool = True
    """Whether shadow rays that pass no opening are left out."""
    straight_through: bool | None = None
    """Whether films have a straight-through peak; None leaves the choice to each film."""
    components: bool = True
    obstructions: bool = True
    """Whether light by way of components is traced, and furniture outside the room exists."""
    pane_to_pane: bool = False
    """Whether photons carry light from pane to pane across the room, and panes mirror into it."""
    beyond: bool = True
    """Whether light that leaves a room through a pane may come back."""
    shade: bool = True
    """Whether the shade may close; otherwise it is left out."""
    every_shade: bool = False
    """Whether the shaded state is simulated for all suns, not only for hours in which it closes."""
    depth: int | None = None
    """Largest number of surfaces that a path meets that follows all bounces; None for any number.
    0 leaves out all light by way of diffuse surfaces."""
    solved_cells: bool = False
    """Whether light between surfaces is solved on cells; otherwise paths follow all bounces."""
    channels: bool | None = None
    """Whether colour channels are simulated one by one; None does so in a coloured scene."""
    pictures: bool = True
    """Whether plots are drawn."""

    def only_sun(self, sun: Sun) -> EnabledEffects:
        """Direct sun alone, by which shades close; patches of the sky, where these stand for it."""
        sky = self.sky and isinstance(sun, ThreePhase)
        return replace(self, sky=sky, ground=False, depth=0, solved_cells=False)

    def enabled_suns(self, suns: Suns) -> np.ndarray:
        """Whether each sun is simulated, shape (sun,); the coefficients of the others are 0."""
        if not self.suns:
            return np.zeros(len(suns.labels), bool)
        if self.sun_visibility is None or not suns.labels:
            return np.ones(len(suns.labels), bool)
        return self.sun_visibility.visible(suns.directions, suns.diameter).mask

    def shines(self, d: mi.Vector3f) -> mi.Bool:
        """Whether the source in each direction d, sky (z ≥ 0) or ground (z < 0), is enabled."""
        if self.sky and self.ground:
            return mi.Bool(True)
        return d.z >= 0 if self.sky else (d.z < 0) & self.ground

    def to_dict(self) -> dict[str, Any]:
        """Plain values that coefficients C depend on, for their fingerprint.

        Which suns light the room and the shade are left out: the weather decides on them, and suns
        or a state that another weather needs are added to known coefficients. Where no sun shines
        at all, known suns would be dark in another weather: such coefficients are their own.
        """
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        for name in ("sun_visibility", "shade", "every_shade", "pictures"):
            del values[name]
        return values


ALL_EFFECTS = EnabledEffects()
"""Everything that a scene holds is simulated."""
