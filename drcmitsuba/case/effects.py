"""The table `[effects]` of a case: choices of the user that overrule the plan."""

from __future__ import annotations

from typing import Literal

from drcmitsuba.runtime.toml import Table

Choice = Literal["auto", "all", "off"]


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
    def overruled(self) -> dict[str, str]:
        """Choices other than "auto", by name of the effect; without `pictures`."""
        chosen = self.model_dump(exclude={"pictures"})
        return {name: choice for name, choice in chosen.items() if choice != "auto"}
