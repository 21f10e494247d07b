"""Planes of mirrors, and the chains that are followed or told to be left out."""

from types import SimpleNamespace

import numpy as np
import pytest

from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.plan import mirrors as plan_mirrors
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.transport.mirrors.mirror_planes import (
    FAINT,
    MOST_CHAINS,
    MirrorFaces,
    chains_left_out,
    chains_of,
    strongest_of,
)


def ring(count):
    """Upright mirrors around a circle of 10 m, fronts inward; no two of them are parallel."""
    quads = []
    for angle in np.arange(count) * np.pi / count:
        out, along = (np.array([np.cos(a), np.sin(a), 0]) for a in (angle, angle + np.pi / 2))
        foot = 10 * out - along
        quads.append(np.array([[foot, foot + [0, 0, 3], foot + 2 * along + [0, 0, 3],
                                foot + 2 * along]]))  # fmt: skip
    return quads


def test_few_mirrors_leave_out_no_chain():
    assert chains_left_out(ring(3), [0.5] * 3) == (0, 0.0)


def test_chains_beyond_the_strongest_are_counted():
    """12 mirrors that all face each other: 12 chains of one, and 12 · 11 of two of them."""
    faces = MirrorFaces.of(ring(12), [0.5] * 12)
    chains = chains_of(faces.rectangles, faces.strongest)
    assert len(chains) == 12 + 12 * 11
    assert len(strongest_of(chains)) == MOST_CHAINS
    assert chains_left_out(ring(12), [0.5] * 12) == (144 - MOST_CHAINS, 0.25)


def test_the_strongest_chains_are_followed():
    rho = np.linspace(0.1, 0.9, 12)
    faces = MirrorFaces.of(ring(12), rho)
    chains = chains_of(faces.rectangles, faces.strongest)
    kept = set(strongest_of(chains))
    assert {(a,) for a in range(12)} < kept  # no mirror loses all of its images
    pairs = [chain for _, chain in chains if len(chain) > 1]
    assert {chain for chain in kept if len(chain) > 1} == set(pairs[: MOST_CHAINS - 12])
    left, strongest = chains_left_out(ring(12), rho)
    assert left == len(chains) - MOST_CHAINS
    assert strongest == pytest.approx(max(value for value, chain in chains if chain not in kept))


def test_faint_chains_count_for_nothing():
    rho = 0.9 * np.sqrt(FAINT)
    assert chains_left_out(ring(12), [rho] * 12) == (0, 0.0)


def test_the_plan_tells_chains_that_are_left_out(monkeypatch):
    mirror = MirrorMaterial(type="mirror", reflectance=0.5)
    surfaces = [Surface(f"facet {i}", mirror, quads, "facets") for i, quads in enumerate(ring(12))]
    monkeypatch.setattr(plan_mirrors, "surfaces_of", lambda *args: surfaces)
    effect = plan_mirrors.mirrors(SimpleNamespace(case=None, reach=None), ALL_EFFECTS)
    left = 144 - MOST_CHAINS
    words = f"{left} pairs of mirrors more send on no sun in turn, the strongest of them 25 % of it"
    assert words in effect.reason
    assert effect.quantities["chains_left_out"] == left
    few = surfaces[:3]
    monkeypatch.setattr(plan_mirrors, "surfaces_of", lambda *args: few)
    effect = plan_mirrors.mirrors(SimpleNamespace(case=None, reach=None), ALL_EFFECTS)
    assert "pairs of mirrors" not in effect.reason
