"""The table `[effects]` of a case: choices of the user that overrule the plan."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from drcmitsuba.runtime.toml import Table

Choice = Literal["auto", "all", "off"]


class Sources(NamedTuple):
    """Whether each source of light shines: factors 1 or 0."""

    sky: float = 1.0
    ground: float = 1.0
    sun: float = 1.0

    def and_of(self, other: Sources) -> Sources:
        """Those of both."""
        return Sources(*(a * b for a, b in zip(self, other, strict=True)))

    def of_bins(self, L: np.ndarray) -> np.ndarray:
        """Luminances (…, bin) of the ground, which comes first, and of the sky's patches."""
        return np.concatenate([self.ground * L[..., :1], self.sky * L[..., 1:]], axis=-1)


class Effects(Table):
    """Effects of light: "auto" follows the plan, "all" always simulates, "off" never simulates."""

    sky: Choice = "auto"
    """Light of the sky."""
    ground: Choice = "auto"
    """Light of the ground below the horizon."""
    suns: Choice = "auto"
    """Light of the suns; "all" includes suns that reach no opening."""
    dark_hours: Literal["auto", "all"] = "auto"
    """Time stamps at which the sun has no radiance; "all" simulates their suns too."""
    clear_panes: Choice = "auto"
    """Clear glass and holes in the façades; "off" puts black sheets there."""
    scattering_panes: Choice = "auto"
    """Light through diffusers."""
    films: Choice = "auto"
    """Light through panes with a measured BSDF."""
    straight_through: Choice = "auto"
    """Views straight through a measured BSDF."""
    components: Choice = "auto"
    """Light by way of components; "off": no photons, only the shadows of the components."""
    pane_to_pane: Choice = "auto"
    """Light that a pane sends to another one across the room, followed by photons."""
    obstructions: Choice = "auto"
    """Furniture outside of the room."""
    shaded_state: Choice = "auto"
    """Coefficients with the shade closed."""
    interreflection: Choice = "auto"
    """Light that met diffuse surfaces; "all": to any depth; "off": none."""
    solved_cells: Choice = "auto"
    """Light between surfaces solved on cells; "off": on paths from the sensors."""
    colour: Choice = "auto"
    """Three channels (red, green, blue) in place of one (luminance)."""
    pictures: Choice = "auto"
    """Pictures of the results. Several façades from one simulation stand side by side in one; "all"
    draws those of each, too."""

    @property
    def sources(self) -> Sources:
        """Sources that are not "off"."""
        return Sources(*(float(one != "off") for one in (self.sky, self.ground, self.suns)))

    @property
    def overruled(self) -> dict[str, str]:
        """Choices other than "auto", by name of the effect; without `pictures`."""
        chosen = self.model_dump(exclude={"pictures"})
        return {name: choice for name, choice in chosen.items() if choice != "auto"}
