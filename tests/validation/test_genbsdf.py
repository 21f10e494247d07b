"""Ours against Radiance: its genBSDF on the same structures, and its reading of our files.

Rationale: genBSDF follows view rays backward through Radiance's own materials, over a device that
is many periods wide; ours follows light forward through one period without edges. Both count into
the cells of the Shirley-Chiu square.

Method: `pyradiance.generate_bsdf` sends a given number of rays per incident cell into the middle
period of 81. Both estimates are means of numbers from 0 to 1, stratified, so that the binomial
variance p(1 − p)/rays bounds that of either; z with both is tested cell by cell (Šidák) and for
the mean over all incident cells. Cells within 20° of grazing are left out: there Radiance's
device has edges. `-u-` fixes Radiance's random numbers, else its seed is the clock's. The acrylic
is traced without Russian roulette (`-lr` above 0): with it 1 of 12 runs had an incident cell that
sends on 1.12 of its light. What `-lw` cuts off instead is 0.3 % of the light.

Expected and found (rays per cell: theirs 500 to 4000, ours 16384): mean hemispherical values
within 0.002, for a saw-tooth of acrylic, diffuse slats and bent mirrors; the largest difference of
an incident cell 0.009 to 0.027; half the sum of the absolute differences of the lobes 0.003 to
0.022 of the light.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from drcmitsuba_plugins import braces, bsdf_file
from drcmitsuba_plugins.tensor import TensorTree, to_direction, unpack
from scipy.stats import norm

from drcmitsuba import goniophotometer as gonio
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.toml import checked
from drcmitsuba.scene.structures.recipe import Recipe
from drcmitsuba.scene.structures.structure import UnitCell, unit_cell
from tests import ROOT, radiance, skips
from tests.fast import slowly

pyradiance = skips.module("pyradiance")

FILM = ROOT / "scenes" / "films" / "prism.xml"
OURS = 16384
LEVEL = 1e-4

ACRYLIC = {
    "kind": "prism", "n": 1.49, "period": 0.5,
    "polygons": [[[0, 0], [0.1, 0], [0.5, 0.2], [0.1, 0.5], [0, 0.5]]],
}  # fmt: skip
SLATS = {"kind": "lamellae", "period": 1.0, "width": 1.2, "tilt": 20.0}
CASES = {
    "acrylic saw-tooth": (ACRYLIC, "dielectric m 0 0 5 1 1 1 1.49 0", "-lr 200 -lw 1e-6", 3, 500),
    "diffuse slats": (
        SLATS | {"reflectance": 0.7}, "plastic m 0 0 5 .7 .7 .7 0 0", "-lr -60 -lw 1e-9",
        2, 4000,
    ),
    "bent mirrors": (
        SLATS | {"turn": 30.0, "reflectance": 1.0, "specular": 1.0},
        "metal m 0 0 5 1 1 1 1 0", "-lr -60 -lw 1e-9", 3, 1000,
    ),
}  # fmt: skip


def device(cell: UnitCell, material: str, periods: int = 40, reach: float = 30.0) -> bytes:
    """Radiance's description of an extruded structure, behind z = 0, with its neighbours."""
    quads = cell.vertices.reshape(-1, 4, 3) * [reach, 1, 1]
    quads[..., 2] -= cell.vertices[:, 2].max()
    lines = [f"void {material}"]
    for k in range(-periods, periods + 1):
        for i, quad in enumerate(quads + [0, k * cell.period[1], 0]):
            numbers = " ".join(f"{v:.9g}" for v in quad.ravel())
            lines.append(f"m polygon p{k}.{i} 0 0 12 {numbers}")
    return "\n".join(lines).encode()


def shares(tree: TensorTree, n: int) -> np.ndarray:
    """Parts of the light (incident, outgoing) on a grid of n cells per side."""
    depth = n.bit_length() - 1
    code = np.arange(n**4)
    at = np.searchsorted(tree.start, code >> 4 * (depth - tree.depth), "right") - 1
    grid = np.zeros((n,) * 4)
    grid[tuple(unpack(code, 4, depth))] = tree.value[at]
    return grid.reshape(n * n, n * n) * (np.pi / n**2)


def agree(ours: np.ndarray, theirs: np.ndarray, rays: int) -> float:
    """Test shares of 0 to 1, entry by entry and their mean; return the largest difference."""
    ours, theirs = ours.ravel(), theirs.ravel()
    p = (ours + theirs) / 2
    well_hit = p * rays > 25  # rarer ones are tested in the sums
    error = np.sqrt(np.clip(p * (1 - p), 1e-4, None) * (1 / rays + 1 / OURS))
    z = ((ours - theirs) / error)[well_hit]
    limit = norm.isf((1 - (1 - LEVEL) ** (1 / z.size)) / 2)
    assert abs(z).max() < limit
    z_mean = (ours - theirs).sum() / np.sqrt((error**2).sum())
    assert abs(z_mean) < norm.isf(LEVEL / 2)
    return float(abs(ours - theirs).max())


@pytest.mark.parametrize("name", slowly(CASES, "acrylic saw-tooth", "bent mirrors"))
def test_genbsdf_finds_the_same(name):
    backend.select()
    structure, material, limits, depth, rays = CASES[name]
    recipe = checked(Recipe, {"structure": structure}, name)
    cell = unit_cell(recipe)
    box = pyradiance.genbsdf.SamplingBox(0, cell.period[1], 0, cell.period[1], -cell.thickness, 0)
    theirs = pyradiance.generate_bsdf(
        device(cell, material),
        params=["-u-", "-ab", "20", "-ad", "4", *limits.split()], recip=False,
        nsamp=rays, pctcull=0, nproc=1, tensortree=4, ttlog2=depth, dim=box,
    )  # fmt: skip
    n = 1 << depth
    u = (np.arange(n) + 0.5) / n
    steep = to_direction(*np.meshgrid(u, u, indexing="ij"))[..., 2].ravel() > np.cos(np.radians(70))
    ours = gonio.expose(recipe, depth=depth, samples=OURS)
    sides = {"b": theirs.front, "f": theirs.back}
    for component in ("tb", "rb", "tf", "rf"):
        side = sides[component[1]]
        data = side.transmittance if component[0] == "t" else side.reflectance
        radiance_says = shares(braces.read(data.decode().strip(), 4), n)[steep]
        we_say = ours.shares(component)[steep]
        total = agree(we_say.sum(axis=1), radiance_says.sum(axis=1), rays)
        agree(we_say, radiance_says, rays)
        lobes = abs(we_say - radiance_says).sum(axis=1).mean() / 2
        mean = we_say.sum(axis=1).mean(), radiance_says.sum(axis=1).mean()
        print(
            f"{name} {component}: {mean[0]:.4f}, Radiance {mean[1]:.4f}; cell {total:.4f}; "
            f"lobes {lobes:.4f}"
        )
        assert mean[0] == pytest.approx(mean[1], abs=3e-3)
        assert lobes < 0.03


def test_radiance_checks_and_reads_the_shipped_film():
    text = radiance.run(["checkBSDF", str(FILM)], FILM.parent).decode()
    lines = re.findall(r"^(Int|Ext)\S* (Refl|Trans)\s+([\d. ]+)\t\s*([\d.]+)%", text, re.M)
    file = bsdf_file.read(FILM)
    names = {"IntRefl": "rf", "ExtRefl": "rb", "IntTrans": "tf", "ExtTrans": "tb"}
    largest = {names[side + kind]: float(value) / 100 for side, kind, _, value in lines}
    assert set(largest) == set(names.values())
    for name, value in largest.items():
        assert file.components[name].albedos().max() == pytest.approx(value, abs=2e-3)
    assert "Anisotropic_Tensor_Tree" in text
    errors = [float(v) for v in re.findall(r"^\S+.*\s[\d.]+\s+([\d.]+)\s+[\d.]+$", text, re.M)]
    assert len(errors) == 3
    assert max(errors) < 15  # per cent, of noise and of merging one direction of a pair


def test_radiance_looks_up_the_values_of_the_shipped_film():
    rng = np.random.default_rng(5)
    v = rng.normal(size=(400, 2, 3))
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    file = bsdf_file.read(FILM)
    loaded = pyradiance.bsdf.load_file(str(FILM))
    angles = np.degrees([np.arccos(v[..., 2]), np.arctan2(v[..., 1], v[..., 0])])
    theirs = np.array(
        [pyradiance.bsdf.query(loaded, *a.T.ravel())[1] for a in angles.transpose(1, 0, 2)]
    )
    assert (theirs > 0).mean() > 0.2
    ours = file.query(v[:, 0], v[:, 1])
    close = np.isclose(ours, theirs, rtol=2e-3, atol=1e-9)
    assert close.mean() > 0.98  # others lie on the border of two cells
