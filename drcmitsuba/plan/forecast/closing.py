"""When the shade will close, as far as geometry tells."""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.materials import GlazingMaterial
from drcmitsuba.plan import Facts, panes
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.scene import outline
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.transport.shadow_rays import Openings

MOST = 128
"""Sensors that are looked at."""


def closing(facts: Facts, scope: EnabledEffects) -> np.ndarray:
    """Guess the time stamps at which the shade closes, bool by time stamp.

    Those at which enough of some sensors see the sun by an opening. Frames and furniture, and what
    glass takes at oblique incidence, are not looked at.

    Parameters
    ----------
    facts : Facts
    scope : EnabledEffects
    """
    case, sky = facts.case, facts.light.sky
    shading = case.shading
    assert shading is not None
    if scope.every_shade:
        return np.ones(facts.hours, bool)
    d = facts.light.sun["direction"].values
    normal = sky["direct_normal_illuminance"].values
    p, n = sensor_points(case)
    some = np.linspace(0, len(p) - 1, min(MOST, len(p))).round().astype(int)
    p, n = p[some], n[some]
    clear = [case.materials.get(n) for n in panes.used(case) if case.is_clear(n)]
    through = max(
        (m.transmittance if isinstance(m, GlazingMaterial) else 1.0 for m in clear), default=1.0
    )
    E = through * normal * np.maximum(n @ d.T, 0)
    room = outline(case, "open", scope, lambda m: None).enclosure
    if room is not None and len(room.openings):
        E = E * Openings(room.openings).reached(p, d, np.zeros(len(d)))
    elif room is not None:
        return np.zeros(len(d), bool)
    return np.asarray((shading.threshold <= E).mean(axis=0) >= shading.area)
