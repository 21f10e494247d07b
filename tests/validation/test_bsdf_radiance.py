"""Measured films: ours against Radiance's pabopto2bsdf and bsdf2ttree, both against a known truth.

Rationale: a goniophotometer gives scattered points at some incidences; what lies between is made up
by interpolation. Radiance fits Gaussians and transports them, we join points by triangles and let
lobes move. Neither is right, so both are held against the BSDF that the points were taken from.

Method: points of an analytic BSDF (a lobe over a Lambertian part), a third of them around the lobe,
written as pab-opto text; a tree of the same depth by both; error at incidences between the measured
ones: ∫|f − truth| / ∫truth over all directions, and the error of the hemispherical total.

Expected: ours is at least as close as Radiance's, in both. Part of both errors are the cells of the
tree themselves (0.22 for the narrow lobe, 0.07 for the wide one).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.tensor import to_direction

from drcmitsuba import bsdf
from drcmitsuba.bsdf.measured import from_measurements
from tests import radiance, skips

pytestmark = skips.RADIANCE.mark


def unit(theta, phi):
    t, p = np.radians(np.asarray(theta, float)), np.radians(np.asarray(phi, float))
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def lobe(o, centre, width, power):
    s = np.sin(np.radians(width))
    apart = ((o[..., :2] - centre) ** 2).sum(axis=-1)
    return power * np.exp(-apart / (2 * s * s)) / (2 * np.pi * s * s)


def scattering(width):
    """Light goes on undeviated, blurred; a fifth is Lambertian."""
    return lambda i, o: 0.2 / np.pi + lobe(o, -i[..., :2], width, 0.5)


def redirecting(i, o):
    """A part goes on undeviated, another is mirrored at a horizontal plane."""
    c = -i[..., :2]
    return 0.1 / np.pi + lobe(o, c, 6, 0.3) + lobe(o, c * [1, -1], 6, 0.4)


def measure(folder: Path, f, incidences, count: int) -> list[str]:
    """Files of transmitted light, in Radiance's coordinates (upphi 90)."""
    rng = np.random.default_rng(0)
    names = []
    for number, (theta, phi) in enumerate(incidences):
        i = unit(theta, phi)
        near = rng.normal(0, 0.12, (count // 2, 2)) - i[:2] * np.array([1, -1])
        near = np.concatenate([near, rng.normal(0, 0.12, (count // 2, 2)) - i[:2]])
        near = near[np.hypot(*near.T) < 0.995]
        z = -np.sqrt(1 - (near**2).sum(axis=1))
        o = np.concatenate([to_direction(*rng.random((2, count)), side=-1), np.c_[near, z]])
        value = f(i, o) * np.abs(o[:, 2])
        angles = np.degrees(np.arccos(o[:, 2])), np.degrees(np.arctan2(o[:, 1], o[:, 0]))
        lines = ["#format: theta phi DSF", f"#incident_angle {theta} {phi}", "#upphi 90"]
        lines += [f"{a:.3f} {b:.3f} {v:.6g}" for a, b, v in zip(*angles, value, strict=True)]
        names.append(f"m{number:02d}.txt")
        (folder / names[-1]).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return names


def by_radiance(folder: Path, names: list[str], depth: int) -> BsdfFile:
    sir = radiance.run(["pabopto2bsdf", "-n", "2", *names], folder)
    (folder / "film.sir").write_bytes(sir)
    command = ["bsdf2ttree", "-g", str(depth), "-t", "0", "film.sir"]
    (folder / "film.xml").write_bytes(radiance.run(command, folder))
    return bsdf.read(folder / "film.xml")


def errors(file: BsdfFile, f, incidences) -> tuple[float, float]:
    """Mean over incidences of ∫|f − truth| / ∫truth and of |∫f / ∫truth − 1|."""
    u = (np.arange(128) + 0.5) / 128
    o = to_direction(*(g.ravel() for g in np.meshgrid(u, u)), side=-1)
    rows = []
    for i in incidences:
        truth, got = f(i, o), file.query(np.broadcast_to(i, o.shape), o)
        rows.append((np.abs(got - truth).mean(), got.mean() - truth.mean()) / truth.mean())
    return tuple(np.abs(rows).mean(axis=0))


def between(count: int) -> np.ndarray:
    """Incidences up to 60°, none of them measured."""
    rng = np.random.default_rng(5)
    return unit(rng.uniform(0, 60, count), rng.uniform(0, 360, count))


@pytest.mark.parametrize(
    ("width", "most"), [pytest.param(4, 0.24, marks=pytest.mark.slow), (12, 0.09)]
)
def test_an_isotropic_film(tmp_path, width, most):
    f = scattering(width)
    names = measure(tmp_path, f, [(t, 0) for t in range(0, 80, 15)], 1000)
    theirs = by_radiance(tmp_path, names, 5)
    ours = from_measurements([tmp_path / name for name in names], depth=5)
    assert ours.kind == theirs.kind == "TensorTree3"
    assert list(ours.components) == list(theirs.components) == ["tf"]
    (shape, total), (their_shape, their_total) = (errors(x, f, between(16)) for x in (ours, theirs))
    print(f"ours {shape:.3f}, {total:.4f}; Radiance {their_shape:.3f}, {their_total:.4f}")
    assert shape < min(their_shape, most)
    assert total < max(their_total, 0.01)


@pytest.mark.slow
def test_a_redirecting_film(tmp_path):
    spots = [(0, 0)] + [(t, p) for t in (20, 40, 60, 75) for p in range(0, 360, 45)]
    names = measure(tmp_path, redirecting, spots, 1500)
    theirs = by_radiance(tmp_path, names, 4)
    ours = from_measurements([tmp_path / name for name in names], depth=4)
    assert ours.kind == theirs.kind == "TensorTree4"
    (shape, total), (their_shape, their_total) = (
        errors(x, redirecting, between(16)) for x in (ours, theirs)
    )
    print(f"ours {shape:.3f}, {total:.4f}; Radiance {their_shape:.3f}, {their_total:.4f}")
    assert shape < their_shape
    assert total < max(their_total, 0.02)
