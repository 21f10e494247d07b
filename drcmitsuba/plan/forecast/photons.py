"""How many photons start, are followed, and how far they fly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.plan.forecast.survey import NEAR, Survey
from drcmitsuba.plan.forecast.walks import photon_flights, straight_through
from drcmitsuba.transport.photon_paths import WEAK
from drcmitsuba.transport.photons import PATCH
from drcmitsuba.transport.ports import PILOT, ComponentPorts, of_sky, of_suns

PHOTONS = 512
"""Starts of photons that are tried on each kind of source and port."""


@dataclass(frozen=True)
class Flown:
    """Photons of one component, or of the panes (""), by one kind of source.

    Parameters
    ----------
    name, kind : str
        Kind of source: "sky" or "sun".
    tried, followed, tests : float
        Photons of a replicate that are drawn, followed, and rays to where they come from.
    flights : float
        Of each one that is followed.
    """

    name: str
    kind: str
    tried: float
    followed: float
    tests: float
    flights: float


def ports_of(survey: Survey) -> tuple[ComponentPorts, ...]:
    """Ports that photons start on in a state; none where none are followed."""
    return ComponentPorts.of(survey.scene) if survey.scene.followed else ()


def pilots(ports: tuple[ComponentPorts, ...]) -> int:
    """Rays that tell once whether ports see anything of the sky, see `PhotonTracer.of`."""
    if not all(each.name for each in ports):
        return 0
    return sum(PILOT * len(each) for each in ports if not each.exposed)


def flown(survey: Survey, ports: ComponentPorts, kind: str) -> Flown:
    """Try some photons of one replicate, from the "sky" or from suns ("sun")."""
    rng, a, scope = np.random.default_rng(11), survey.accuracy, survey.scope
    if kind == "sky":
        sources = of_sky(survey.subdivision or 1)
        followed = np.array([scope.ground, *[scope.sky] * (survey.patches - 1)], bool)
        followed = followed[: survey.patches]
    else:
        sources = of_suns(survey.suns.directions, survey.suns.diameter)
        followed = np.ones(len(survey.suns.directions), bool)
    could = ports.could(sources)[: len(followed)] * followed[:, None]
    seen = np.flatnonzero(could.any(axis=1))
    tried = len(seen) * a.photons * (PATCH if kind == "sky" else 1)
    if not len(seen):
        return Flown(ports.name, kind, 0.0, 0.0, 0.0, 0.0)
    source = seen[rng.integers(len(seen), size=PHOTONS)]
    share = could[source] / could[source].sum(axis=1, keepdims=True)
    port = (share.cumsum(axis=1) > rng.random((PHOTONS, 1))).argmax(axis=1)
    corner, u, v = ports.edges
    x, y = rng.random((2, PHOTONS, 1))
    p = corner[port] + x * u[port] + y * v[port]
    d = sources.centre[source] + sources.radius[source, None] * _ball(PHOTONS, rng)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    faces = (d * ports.normal[port]).sum(axis=1) < 0
    if ports.in_line:
        faces &= ~_passed(ports, p, d)
    p, d = p[faces] + NEAR * d[faces], d[faces]
    free = straight_through(survey.scout, p, d)
    flights = photon_flights(
        survey.scout, p[free], -d[free], name=ports.name, weak=WEAK, limit=a.photon_surfaces,
        rng=rng,
    )  # fmt: skip
    tests = 0.0 if ports.exposed else tried * float(faces.mean())
    return Flown(ports.name, kind, tried, tried * float(free.sum()) / PHOTONS, tests, flights)


def _passed(ports: ComponentPorts, p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether light from directions d (ray, 3) has passed another port before it comes to p."""
    corner, u, v = ports.edges
    n, area = ports.normal, ports.area[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((corner * n).sum(axis=1) - p @ n.T) / (d @ n.T)
        at = p[:, None] + t[..., None] * d[:, None] - corner
        x = (at * (np.cross(v, n) / area)).sum(axis=2)
        y = (at * (np.cross(n, u) / area)).sum(axis=2)
    before = (d @ n.T < 0) & (t > NEAR) & (x >= 0) & (x < 1) & (y >= 0) & (y < 1)
    return np.asarray(before.any(axis=1))


def _ball(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in the unit ball."""
    d = rng.standard_normal((count, 3))
    radius = np.cbrt(rng.random((count, 1)))
    return d / np.linalg.norm(d, axis=1, keepdims=True) * radius
