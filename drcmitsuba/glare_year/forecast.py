"""Forecast of the time of a year of glare, from its numbers of places, suns, mirrors and photons.

Most of the time goes into C of the points of surfaces that the eyes see. A place sees some 1500 of
them. Where photons are followed, each set of points that is in memory at once has photons of its
own.

Limits: the glow of films and what kernels take to compile is not counted.
"""

from __future__ import annotations

import math

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.pixels import SIDE
from drcmitsuba.glare_year.state import COEFFICIENTS
from drcmitsuba.plan.forecast.cost import KERNELS
from drcmitsuba.runtime import machine_speed
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.mirrors.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.photons.ports import ComponentPorts, of_sky
from drcmitsuba.transport.photons.tracer import of_patch

POINTS = 1.15
"""Number of points of surfaces for each tile of the view, in furnished offices."""
COEFFICIENT = 1.7e-7
"""Time of a coefficient of such a point in a replicate [s], fitted to three offices, of whose
points 3, 53 and 82 % are dim."""
CHAIN = 0.55
"""The same for a chain of mirrors seen from the room, over that of a coefficient without them."""
LOBES = 4
"""Chains of mirrors that take as long as the lobes of the rough mirrors of one axis."""
SURFACES = 6
"""Number of surfaces that a photon meets, in the mean."""
LEAST = 8.0
"""Time of weather, plan and files, and of E_v at few eyes [s]."""


def seconds(
    case: Case, states: list[State], light: Daylight, looking: Eyes, effects: EnabledEffects
) -> float:
    """Forecast the time of `year.glare` on this machine under its present load [s]."""
    suns = int(effects.enabled_suns(light.suns).sum())
    patches, a = light.sky.sizes["bin"], case.accuracy
    places = looking.by_place()
    tiles = sum(_tiles(looking.forward[views]) for views in places)
    channels = scene.channels_of(case, effects)
    total = 0.0
    for state in states:
        world = scene.load(case, state, channels[0], effects)
        mirrors = PlanarMirrors.of(world)
        looks_in = mirrors is not None and (effects.pane_to_pane or mirrors.has_bodies)
        chains = len(mirrors.chains) if mirrors is not None and looks_in else 0
        chains += LOBES * sum(len(m.axes) for m in PlanarMirrors.rough(world).values())
        each = COEFFICIENT * a.replicates * (suns * (1 + CHAIN * chains) + patches)
        total += tiles * POINTS * each
        ports = len(ComponentPorts.of(world)) if world.followed else 0
        subdivision = case.sky.subdivision
        by_sky = len(of_sky(subdivision).bins) * of_patch(a.photons, subdivision)
        photons = a.replicates * (a.photons * suns + by_sky * (patches > 0))
        sets = 1 + math.ceil(tiles * POINTS * (suns + patches) / COEFFICIENTS)
        total += sets * ports * photons * SURFACES * KERNELS["photon"]
    return LEAST + len(channels) * total / machine_speed.speed().rays


def _tiles(forward: np.ndarray) -> int:
    """Number of tiles that some lines of sight have before them, roughly."""
    spread = np.linalg.norm(forward.mean(axis=0))
    return round(SIDE**2 * (1 if spread > 0.99 else 2))
