"""Radiance's contribution photon map, `mkpmap -apC` and `rcontrib -ap`, for rooms with a component.

As EvalDRC had it: every 0.5° sun is a `source` with a modifier of its own, suns go into maps in
groups, photons start on ports, and irradiance is estimated on invisible receivers where sensors
are. What was found out about it (Radiance 6.0a, and read in its source):

- Glass, `metal` and `dielectric` all make caustics of what passes them, so light straight through
  a pane is in the map, too, and shadow rays stop at it. An open hole is left to shadow rays.
- A port may be the pane itself: photons start before it and are attenuated by it once. Its normal
  points into the room. A hole needs a port of `antimatter`, which photons cross unchanged.
- Photons lie on surfaces; at a sensor in mid-air a look-up finds those of the floor, or none.
  A receiver is `antimatter` named by `-aps`; it keeps photons that come to its front.
- A receiver next to a surface that faces the same way has photons in both counted: twice the light.
- Shadow rays do not pass an `antimatter` port: light straight through its hole is lost.
- A look-up takes the `bandwidth` photons nearest to the sensor **of all suns together** over one
  common area. So a sensor in the dark of one sun, lit by the others, has a share of what light of
  that sun lies near; and a sun's own estimate has only its share of the photons. The estimate is
  blurred over r = √(bandwidth / (π · photons per area)), and at the receiver's edge light is lost.
- `-ab -1` looks up at the sensor. With `-ab 1` interreflected light is gathered by `-ad` rays,
  whose ends look up photons instead, and only caustics are looked up at the sensor: less blur.
- `-V+` and suns of SUN_RADIANCE as for shadow rays; a map keeps flux in the 8 bits of RGBE.
- `metal` gets a Fresnel term of its own unless it is rough; see `export.primitives`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from drcmitsuba.export.primitives import polygon
from drcmitsuba.export.sources import SUN_RADIANCE
from drcmitsuba.scene.geometry import Surface
from tests import radiance

DIRECT = ("-ab", "-1")
"""Density of photons at the sensor."""


def gathered(rays: int) -> tuple[str, ...]:
    """Options: interreflected light by so many rays from each sensor."""
    return ("-ab", "1", "-ad", f"{rays}", "-lw", "1e-9")


@dataclass(frozen=True)
class Estimate:
    """Coefficients by photon maps, and what they took.

    Parameters
    ----------
    coefficients : np.ndarray, shape (sensor, sun)
        [sr].
    emission, look_up : float
        Of `mkpmap` and `rcontrib` [s].
    size : int
        Of all maps on disk [byte].
    """

    coefficients: np.ndarray
    emission: float
    look_up: float
    size: int

    @property
    def seconds(self) -> float:
        return self.emission + self.look_up


@dataclass(frozen=True)
class PhotonRoom(radiance.Room):
    """A scene for Radiance with photon ports and receivers, and the sensors on them.

    Parameters
    ----------
    ports : tuple of str
        Modifiers of the surfaces that photons start on.
    cores : int
        Processes; photons depend on their number.
    """

    ports: tuple[str, ...] = ()
    cores: int = 1

    def photons(
        self, directions: np.ndarray, diameter: float, *, count: int, bandwidth: int,
        seed: int = 1, group: int | None = None, options: Sequence[str] = DIRECT,
    ) -> Estimate:  # fmt: skip
        """Coefficients of suns by contribution photon maps.

        Parameters
        ----------
        directions : np.ndarray, shape (sun, 3)
            To the suns.
        diameter : float
            [°].
        count : int
            Photons to be stored in each map; every sun has about an equal part of them.
        bandwidth : int
            Photons of a look-up.
        seed : int
            Of `mkpmap`.
        group : int, optional
            Suns in a map; without it, all.
        options : sequence of str
            DIRECT or `gathered`.
        """
        group = group or len(directions)
        parts, taken, size = [], np.zeros(2), 0
        for first in range(0, len(directions), group):
            suns = directions[first : first + group]
            octree = self._suns_octree(suns, diameter)
            ports = [word for port in self.ports for word in ("-apo", port)]
            start = perf_counter()
            radiance.run(
                ["mkpmap", "-n", f"{self.cores}", "-apC", "suns.cpm", f"{count}",
                 "-apr", f"{seed}", "-fo+", *ports, "-aps", "receiver", octree], self.folder,
            )  # fmt: skip
            half = perf_counter()
            output = radiance.run(
                ["rcontrib", "-n", f"{self.cores}", "-h", "-faf", "-I+", "-V+", *options,
                 "-ap", "suns.cpm", f"{bandwidth}", "-M", "suns.txt", octree],
                self.folder, self._rays(1),
            )  # fmt: skip
            taken += half - start, perf_counter() - half
            size += (self.folder / "suns.cpm").stat().st_size
            parts.append(self._matrix(output, 1)[0])
        return Estimate(np.concatenate(parts, axis=-1) / SUN_RADIANCE, *taken, size)

    def repeated(
        self, directions: np.ndarray, diameter: float, repeats: int, **how: object
    ) -> tuple[np.ndarray, Estimate]:
        """Coefficients (repeat, sensor, sun) of maps with seeds of their own, and the last."""
        estimates = [
            self.photons(directions, diameter, seed=seed, **how)  # type: ignore[arg-type]
            for seed in range(1, repeats + 1)
        ]
        return np.stack([e.coefficients for e in estimates]), estimates[-1]


def receivers(quads: np.ndarray) -> str:
    """Invisible rectangles (quad, 4, 3) that keep what arrives at their fronts."""
    lines = ["void antimatter receiver 1 void 0 0"]
    lines += [polygon("receiver", f"r{i}", quad) for i, quad in enumerate(quads)]
    return "\n".join(lines) + "\n"


def open_port(name: str, quad: np.ndarray) -> str:
    """A port in a hole, facing inward."""
    return f"void antimatter {name} 1 void 0 0\n{polygon(name, name + '_', quad)}\n"


def modifiers(surfaces: Sequence[Surface], names: Sequence[str]) -> tuple[str, ...]:
    """Modifiers in `radiance.scene_text` of surfaces by their names.

    Raises
    ------
    KeyError
        No surface has one of the names.
    """
    at = {surface.name: f"m{i}" for i, surface in enumerate(surfaces)}
    return tuple(at[name] for name in names)
