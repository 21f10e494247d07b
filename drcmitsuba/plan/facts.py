"""Facts about a case that decide on its effects."""

from __future__ import annotations

from dataclasses import dataclass

from drcmitsuba.case.case import Case
from drcmitsuba.plan import panes
from drcmitsuba.scene.components import PlacedComponent
from drcmitsuba.scene.sun_visibility import SunVisibility, VisibleSuns, outside
from drcmitsuba.sky.daylight import Daylight


@dataclass(frozen=True)
class Facts:
    """Facts about a case that decide on its effects.

    Parameters
    ----------
    case : Case
    light : Daylight
    components : tuple of PlacedComponent
    reach : SunVisibility or None
        Openings and obstructions of the room; None where there is no room.
    reached : VisibleSuns
        Suns of `light.suns` that can get in.
    """

    case: Case
    light: Daylight
    components: tuple[PlacedComponent, ...]
    reach: SunVisibility | None
    reached: VisibleSuns

    @property
    def hours(self) -> int:
        """Number of time stamps."""
        return self.light.sky.sizes["time"]

    @property
    def stamps(self) -> int:
        """Number of time stamps whose light is simulated: those of the year, where it is."""
        return self.light.every.sky.sizes["time"]

    @property
    def shut(self) -> bool:
        """Whether the room has no opening at all."""
        return self.reach is not None and len(self.reach.openings) == 0

    @property
    def shadeless(self) -> bool:
        """Whether there is no clear pane, which a shade could cover."""
        return not any(self.case.is_clear(name) for name in panes.used(self.case))

    @property
    def outside(self) -> list[str]:
        """Names of what stands outside of the room."""
        context = [layer.name for layer in self.case.building.layers if layer.role == "context"]
        return [piece.name for piece in outside(self.case)] + context

    @property
    def surrounded(self) -> bool:
        """Whether anything outside may send light back."""
        return bool(self.outside or self.case.standing or self.case.building.layers)
