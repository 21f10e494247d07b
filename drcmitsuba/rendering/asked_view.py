"""Light paths of a view: of which façade, in which parts, and where they are kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from drcmitsuba.plan import plan, reflected
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.rendering import file_name
from drcmitsuba.rendering.view_colours import ViewBands
from drcmitsuba.rendering.view_facade import ViewFacade
from drcmitsuba.rendering.view_parts import ViewPart
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.fills import Fills, effects_of
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import daylight


def effects_of_view(facade: ViewFacade, fills: Fills, pixels: int) -> EnabledEffects:
    """Effects of a picture at any hour, and whether light between surfaces is solved on cells."""
    case = facade.case
    planned = plan(case, daylight(case))
    scope = planned.scope
    if fills and facade.panes is not None:
        scope = effects_of(facade.panes, scope, case)
    solved = reflected.solved_cells(planned.facts, scope.depth, pixels)
    solved = solved.decided("solved_cells", case.effects.solved_cells)
    channels = False if case.colour.wavelengths else scope.channels  # bands have the colour
    return replace(
        scope, sky=case.effects.sky != "off", suns=case.effects.suns != "off", shade=True,
        solved_cells=solved.on and scope.depth != 0, channels=channels,
        sun_visibility=None,  # a view from outside shows what the sun lights there
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class AskedView:
    """Light paths of a view that are asked for."""

    name: str
    """Name of the view."""
    facade: ViewFacade
    effects: EnabledEffects
    sampling: Sampling
    stated: Mapping[str, Any]
    """Inputs of light paths but for the façade."""
    folder: Path | None
    """Folder in which the light paths of all views are kept; None without any."""

    @property
    def content(self) -> dict[str, Any]:
        """Inputs of light paths."""
        return {**self.stated, "facade": self.facade.stated}

    @property
    def channels(self) -> int:
        """Number of colour channels, or one of luminance, which come before the bands."""
        return len(scene.channels_of(self.facade.case, self.effects))

    @cached_property
    def bands(self) -> ViewBands | None:
        """Bands of a case that has them."""
        return ViewBands.of(self.facade.case, self.facade.states)

    @cached_property
    def parts(self) -> list[ViewPart]:
        """Channels, then bands."""
        facade, effects, case = self.facade, self.effects, self.facade.case
        parts = [
            ViewPart(
                f"channel_{max(0, channel)}", facade.scenes(channel, effects), self.sampling,
                case.accuracy,
            )
            for channel in scene.channels_of(case, effects)
        ]  # fmt: skip
        if self.bands is None:
            return parts
        scenes = partial(facade.scenes, effects=effects)
        tinted = self.bands.parts(lambda channel, tint: scenes(channel, tint=tint), self.sampling)
        return [*parts, *tinted]

    @property
    def path(self) -> Path | None:
        """Folder of these light paths, which has the name of the state where it is one of several.

        It is None where no light paths are kept.
        """
        if self.folder is None:
            return None
        groups = prepared(self.facade.case).groups.states
        is_one = self.facade.panes is None and any(groups.closable)
        name = file_name(f"{self.name}_{self.facade.state}" if is_one else self.name)
        return self.folder / f"{name}_light_paths"
