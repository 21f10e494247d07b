"""Radiance of what is outside: the continuous sky of an hour, the ground, and the sun's disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import on_disk

from drcmitsuba.case.case import Case
from drcmitsuba.picture.view import PictureView
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.scene import Scene
from drcmitsuba.sky.daylight import Daylight, sky_luminance
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.rays.shadow_rays import straight

AZIMUTHS, ALTITUDES = 720, 181
"""Steps of the table of the sky, half a degree each."""
ON_DISK = 32
"""Number of places along the edge of a pixel at which the sun's disk is looked for."""
MOST_PIXELS = 4096
"""Largest number of pixels of the sun's image at this number of places; larger ones take fewer."""


@dataclass(frozen=True)
class OutsideLuminances:
    """Luminances of the sky, the ground and the sun at an instant."""

    table: np.ndarray
    """Luminance of the sky [cd/m²], shape (altitude, azimuth): altitudes from 0 to 90°, azimuths
    from north by east, the first and the last alike."""
    ground: float
    """Luminance of the ground [cd/m²]."""
    sun: float
    """Luminance of the sun [cd/m²]; 0 where it is not up or does not shine."""
    direction: np.ndarray
    """Unit vector to the sun, shape (3,)."""
    diameter: float
    """Angle across the sun [deg]."""

    @classmethod
    def of(cls, case: Case, light: Daylight, index: int) -> OutsideLuminances:
        """Tabulate the sky at one of the time stamps of a daylight of instants."""
        here = light.sky.isel(time=index)
        altitude = np.linspace(0, np.pi / 2, ALTITUDES)[:, None]
        azimuth = np.linspace(0, 2 * np.pi, AZIMUTHS + 1)
        d = [
            np.cos(altitude) * np.sin(azimuth),
            np.cos(altitude) * np.cos(azimuth),
            np.maximum(np.sin(altitude), 1e-4) + 0 * azimuth,
        ]
        nodes = np.stack(d, axis=-1).reshape(-1, 3)
        table = sky_luminance(case, here["time"].values, nodes).reshape(ALTITUDES, AZIMUTHS + 1)
        return cls(
            table, float(here["sky"][0]), float(here["sun"]), here["sun_direction"].values,
            case.outside.sun_diameter,
        )  # fmt: skip

    def times(self, sky: np.ndarray | float, ground: float, sun: float) -> OutsideLuminances:
        """Each source so many times as bright: the sky (altitude, azimuth), the ground, the sun."""
        return replace(
            self, table=self.table * sky, ground=self.ground * ground, sun=self.sun * sun
        )

    @cached_property
    def _flat(self) -> mi.Float:
        return flat(self.table)

    def sky(self, d: mi.Vector3f) -> mi.Float:
        """Luminance of sky and ground in directions [cd/m²], without the sun."""
        x = dr.atan2(d.x, d.y) * (AZIMUTHS / (2 * np.pi))
        x = dr.select(x < 0, x + AZIMUTHS, x)
        y = dr.atan2(d.z, dr.sqrt(d.x * d.x + d.y * d.y)) * ((ALTITUDES - 1) / (np.pi / 2))
        i = mi.UInt32(dr.clip(x, 0, AZIMUTHS - 1))
        j = mi.UInt32(dr.clip(y, 0, ALTITUDES - 2))
        u, v = x - mi.Float(i), dr.clip(y - mi.Float(j), 0, 1)

        def node(row: mi.UInt32, column: mi.UInt32) -> mi.Float:
            return dr.gather(mi.Float, self._flat, row * (AZIMUTHS + 1) + column)

        low = dr.lerp(node(j, i), node(j, i + 1), u)
        high = dr.lerp(node(j + 1, i), node(j + 1, i + 1), u)
        ground = dr.opaque(mi.Float, self.ground)
        return dr.select(d.z < 0, ground, dr.lerp(low, high, v))

    def with_sun(self, d: mi.Vector3f, share: mi.Float) -> mi.Float:
        """Luminance in directions [cd/m²], with a share of that of the sun's disk [–]."""
        disk = on_disk(d, self._centre, self.diameter)
        return self.sky(d) + dr.select(disk, share * dr.opaque(mi.Float, self.sun), 0)

    @property
    def _centre(self) -> mi.Vector3f:
        return dr.opaque(mi.Vector3f, list(map(float, self.direction)))

    def disk_in(
        self, scene: Scene, view: PictureView, shape: tuple[int, int], images: ImageSuns | None
    ) -> np.ndarray:
        """Luminance of pixels by the sun's disk, straight through clear panes and in mirrors.

        Parameters
        ----------
        scene : Scene
        view : PictureView
            View in the scene's frame.
        shape : tuple of int
            Rows and columns.
        images : ImageSuns, optional
            Planar mirrors of the scene, in which the disk is seen as well.

        Returns
        -------
        np.ndarray, shape (row, column)
            Mean over each pixel [cd/m²].
        """
        out = np.zeros(shape, np.float32)
        if self.sun <= 0:
            return out
        eye = mi.Point3f(*map(float, view.position))

        def straight_on(d: mi.Vector3f) -> mi.Float:
            return straight(scene, eye, d, dr.full(mi.Bool, True, dr.width(d)))

        self._add_disk(out, view, self.direction, straight_on)
        if images is not None:
            every = images.mirrors.rectangles  # rays count no sun on either side of a pane
            for d, _, reached in images.seen_from(eye, self.direction[None], self.diameter, every):
                self._add_disk(out, view, d[0], reached)
        return out

    def _add_disk(
        self, out: np.ndarray, view: PictureView, centre: np.ndarray,
        reached: Callable[[mi.Vector3f], mi.Float],
    ) -> None:  # fmt: skip
        """Add the disk around a direction to pixels (row, column), as far as its light arrives."""
        rows, columns = out.shape
        pixels = self._near(view, centre, rows, columns)
        if not len(pixels):
            return
        places = max(4, int(ON_DISK * min(1, np.sqrt(MOST_PIXELS / len(pixels)))))
        step = (np.arange(places) + 0.5) / places
        u, v = (a.ravel() for a in np.meshgrid(step, step))
        x = (pixels[:, 1, None] + u) / columns
        d = view.directions(x, 1 - (pixels[:, 0, None] + v) / rows)
        chord = 4 * np.sin(np.radians(self.diameter) / 4) ** 2
        pixel, place = np.nonzero(((d - centre) ** 2).sum(axis=-1) <= chord)
        if not len(pixel):
            return
        tau = reached(mi.Vector3f(*map(flat, d[pixel, place].T)))
        share = np.bincount(pixel, tau.numpy(), len(pixels)) / places**2
        out[pixels[:, 0], pixels[:, 1]] += self.sun * share

    def _near(self, view: PictureView, centre: np.ndarray, rows: int, columns: int) -> np.ndarray:
        """Pixels (pixel, 2: row and column) that may show a part of the disk around a direction."""
        frame = np.linalg.svd(centre[None])[2]  # its last rows lie across the direction
        radius, turn = np.radians(self.diameter) / 2, np.linspace(0, 2 * np.pi, 32)[:, None]
        rim = np.sin(radius) * (np.cos(turn) * frame[1] + np.sin(turn) * frame[2])
        x, y = view.places(np.vstack([centre, np.cos(radius) * centre + rim]))
        known = np.isfinite(x) & np.isfinite(y)
        if not known.any():
            return np.zeros((0, 2), int)
        across, down = x[known] * columns, (1 - y[known]) * rows
        low = np.floor([down.min(), across.min()]).astype(int) - 1
        high = np.ceil([down.max(), across.max()]).astype(int) + 1
        low, high = np.clip(low, 0, shape := (rows, columns)), np.clip(high, 0, shape)
        place = np.mgrid[low[0] : high[0], low[1] : high[1]]
        return place.reshape(2, -1).T
