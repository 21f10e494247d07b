"""A view whose façade is in one state, as pictures of any hour are summed from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.caustics import Caustics
from drcmitsuba.rendering.pixel_paths import PixelPaths, Sampling
from drcmitsuba.rendering.surface_light import SurfaceLight
from drcmitsuba.rendering.view_glow import ViewGlow
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.sun_lobes import SunLobes


@dataclass(frozen=True)
class TracedView:
    """Light paths of a whole picture, and the light on the surfaces of its scene."""

    scene: Scene
    view: PictureView
    """View in the frame in which the scene is traced."""
    rows: int
    columns: int
    sampling: Sampling
    light: SurfaceLight
    glow: ViewGlow
    tiles: Callable[[], Iterator[PixelPaths]]
    """Gives the light paths of all pixels, some at a time."""

    @cached_property
    def images(self) -> ImageSuns | None:
        """Images of suns in the planar mirrors of the scene; None without any."""
        return ImageSuns.of(self.scene)

    @cached_property
    def lobes(self) -> tuple[SunLobes, ...]:
        """Lobes of suns in the rough mirrors of the scene."""
        return SunLobes.of(self.scene)

    @cached_property
    def caustics(self) -> Caustics | None:
        """Photons of the components of the scene; None without any."""
        base = self.light.base
        return Caustics.of(
            self.scene, base.accuracy, base.subdivision, base.diameter, self.glow.table
        )
