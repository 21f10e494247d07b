"""The table `[effects]` of a case: decisions of the plan that the user takes himself."""

from __future__ import annotations

from typing import Literal

from drcmitsuba.case.toml import Table

Choice = Literal["auto", "all", "off"]


class Effects(Table):
    """What is simulated: "auto" as the scene calls for, "all" in any case, "off" in none."""

    sky: Choice = "auto"
    ground: Choice = "auto"
    suns: Choice = "auto"
    """"all": every sun above the horizon, also those that can get into no opening."""
    dark_hours: Literal["auto", "all"] = "auto"
    """"all": the suns of time stamps at which the sun has no radiance, too."""
    clear_panes: Choice = "auto"
    """Clear glass and holes in the façades; "off" puts black sheets there."""
    scattering_panes: Choice = "auto"
    films: Choice = "auto"
    straight_through: Choice = "auto"
    components: Choice = "auto"
    """"off": no photons; components stand where they are and cast shadows."""
    pane_to_pane: Choice = "auto"
    """Light that a pane sends to another one across the room, followed by photons."""
    obstructions: Choice = "auto"
    """Furniture outside of the room."""
    shaded_state: Choice = "auto"
    interreflection: Choice = "auto"
    """"all": to any depth; "off": light that met a surface of the room counts for nothing."""
    colour: Choice = "auto"
    pictures: Choice = "auto"

    @property
    def overruled(self) -> dict[str, str]:
        """Choices on effects of light that are not left to the plan."""
        chosen = self.model_dump(exclude={"pictures"})
        return {name: choice for name, choice in chosen.items() if choice != "auto"}
