"""Plugins `tensor_tree` and `klems`: values, sampling, peak, energy, mounting, gradients."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file, peak
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.measured_hooks import Lobes, MeasuredHooks
from drcmitsuba_plugins.tensor import TensorTree, to_square
from scipy.stats import chi2 as chi2_law

from drcmitsuba.runtime import backend
from tests import SHARED, skips
from tests.fast import slowly
from tests.unit.plugins.measured_files import (
    IMPORTANCE,
    KINDS,
    NAMES,
    RADIANCE,
    as_vector,
    draw,
    interaction,
    load,
    random_directions,
    vector,
    write,
    xml,
)

SHARED = SHARED / "data" / "bsdf"


@pytest.fixture(autouse=True, scope="module")
def _first_variant():
    backend.select()


# Values


@pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
@pytest.mark.parametrize("missing", [(), ("tb",), ("tf", "rf")], ids=["all", "no tb", "tb rb"])
@pytest.mark.parametrize("kind", KINDS)
def test_eval_is_the_files_value_times_the_cosine(tmp_path, kind, missing, mode):
    path = write(tmp_path, kind, missing)
    file, bsdf = bsdf_file.read(path), load(path, straight_through="off")
    wi, wo = random_directions(20_000), random_directions(20_000, 1)
    value = bsdf.eval(mi.BSDFContext(mode), interaction(wi, len(wi)), as_vector(wo))[0].numpy()
    incident, outgoing = (wo, wi) if mode == RADIANCE else (wi, wo)
    expected = file.query(incident, outgoing) * np.abs(wo[:, 2])
    # Directions that single precision puts into the neighbouring cell: a few in 10⁴.
    off = ~np.isclose(value, expected, rtol=1e-4, atol=1e-7)
    assert off.mean() < 1e-3
    assert (expected > 0).mean() > 0.2


def test_a_lambertian_tree_is_a_diffuser(tmp_path):
    path = tmp_path / "even.xml"
    t, r = 0.3, 0.4
    data = {n: "{%r}" % ((t if n[0] == "t" else r) / np.pi) for n in NAMES}
    path.write_text(xml("TensorTree4", data))
    ours, plain = (
        load(path),
        mi.load_dict({"type": "diffuser", "transmittance": t, "reflectance_front": r}),
    )
    wi, wo = random_directions(1000), random_directions(1000, 1)
    for mode in (RADIANCE, IMPORTANCE):
        si, ctx = interaction(wi, len(wi)), mi.BSDFContext(mode)
        for a, b in zip(
            ours.eval_pdf(ctx, si, as_vector(wo)), plain.eval_pdf(ctx, si, as_vector(wo)),
            strict=True,
        ):  # fmt: skip
            np.testing.assert_allclose(np.array(a).ravel(), np.array(b).ravel(), rtol=1e-5)
    assert not ours.has_view


# Sampling


def chi_square(bsdf, wi, mode, count=200_000, seed=1, grid=12, inner=96):
    """p-value of samples counted in squares of the outgoing disk against the density."""
    bs, weight = draw(bsdf, wi, mode, count, seed)
    assert np.isfinite(weight[0].numpy()).all()
    kept = bs.pdf.numpy() > 0
    wo = np.array(bs.wo).T[kept]
    s = np.clip((np.array(to_square(wo[:, 0], wo[:, 1])) * grid).astype(int), 0, grid - 1)
    cell = (s[0] * grid + s[1]) + grid**2 * (wo[:, 2] < 0)
    seen = np.bincount(cell, minlength=2 * grid**2).astype(float)
    n = grid * inner
    lane = dr.arange(mi.UInt32, n * n)
    point = (mi.Point2f(mi.Float(lane // n), mi.Float(lane % n)) + 0.5) / n
    disk = mi.warp.square_to_uniform_disk_concentric(point)
    z = dr.safe_sqrt(1 - dr.squared_norm(disk))
    expected = []
    for side in (1, -1):
        d = mi.Vector3f(disk.x, disk.y, side * z)
        pdf = bsdf.pdf(mi.BSDFContext(mode), interaction(wi, n * n), d) / z
        mean = pdf.numpy().reshape(grid, inner, grid, inner).mean(axis=(1, 3), dtype=float)
        expected.append(mean.ravel() * np.pi / grid**2)
    expected = np.concatenate(expected)
    assert expected.sum() == pytest.approx(1, abs=0.01)  # the points cut through cells
    expected *= kept.sum() / expected.sum()
    few = expected < 20
    seen = np.append(seen[~few], seen[few].sum())
    expected = np.append(expected[~few], expected[few].sum())
    seen, expected = seen[expected > 0], expected[expected > 0]
    # What the points miss where they cut through a cell counts as an error of the expectation.
    variance = expected + (0.01 * expected) ** 2
    return chi2_law.sf(((seen - expected) ** 2 / variance).sum(), len(seen) - 1)


INCIDENCES = [(0.5, 0), (30, 100), (60, 200), (80, 45), (89, 300)]


@pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
@pytest.mark.parametrize("kind", slowly(KINDS[:3], KINDS[0]))
def test_samples_follow_their_density(tmp_path, kind, mode):
    bsdf = load(write(tmp_path, kind), straight_through="off")
    worst = min(
        chi_square(bsdf, vector(*angles) * [1, 1, side], mode)
        for angles in INCIDENCES
        for side in (1, -1)
    )
    assert worst > 1 - (1 - 1e-3) ** (1 / (2 * len(INCIDENCES)))


def test_the_test_of_samples_would_notice_a_wrong_density(tmp_path):
    a, b = (load(write(tmp_path, "TensorTree4", seed=s), straight_through="off") for s in (1, 2))

    class Mixed:
        sample, pdf = a.sample, b.pdf

    assert chi_square(Mixed, vector(30, 100), RADIANCE) < 1e-6


@pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
@pytest.mark.parametrize("kind", slowly(KINDS, KINDS[0], *KINDS[4:]))
def test_weights_are_eval_over_density_and_hardly_vary(tmp_path, kind, mode):
    bsdf = load(write(tmp_path, kind), straight_through="off")
    for angles in INCIDENCES:
        for side in (1, -1):
            wi = vector(*angles) * [1, 1, side]
            bs, weight = draw(bsdf, wi, mode, 20_000)
            weight = weight[0].numpy().astype(float)
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(mode), interaction(wi, 20_000), bs.wo)
            value, pdf = value[0].numpy(), pdf.numpy()
            off = ~np.isclose(pdf, bs.pdf.numpy(), rtol=1e-3)
            off |= ~np.isclose(weight * pdf, value, rtol=1e-3, atol=1e-7)
            assert off.mean() < 1e-3
            spread = (weight**2).mean() / weight.mean() ** 2
            if kind == "TensorTree3" and mode == RADIANCE:
                assert spread < 1.3
            else:
                assert spread < 1 + 1e-4  # exactly in proportion to f cos θ


@pytest.mark.parametrize("kind", KINDS)
def test_the_mean_weight_is_the_albedo(tmp_path, kind):
    path = write(tmp_path, kind)
    file, bsdf = bsdf_file.read(path), load(path, straight_through="off")
    for side in (1, -1):
        wi = vector(40, 70) * [1, 1, side]
        _, weight = draw(bsdf, wi, IMPORTANCE, 100_000)
        t, r = file.hemispherical(wi)
        assert weight[0].numpy().mean() == pytest.approx(float(t[0] + r[0]), rel=0.005)


# The straight-through peak


def peaked(folder, kind="TensorTree4"):
    """File that lets T = 0.5 straight through and scatters 0.2 evenly."""
    path = folder / f"peaked{kind[-4:].strip()}.xml"
    even = 0.2 / np.pi
    if kind == "TensorTree4":
        n = 8
        s = np.indices((n,) * 4).reshape(4, -1)
        grid = np.full((n,) * 4, even)
        straight = (s[0] == s[2]) & (s[1] == s[3])
        grid.reshape(-1)[straight] += 0.5 * n * n / np.pi
        data = "{" + " ".join(f"{v:.8g}" for v in grid.ravel()) + "}"
        path.write_text(xml(kind, {"tb": data}))
    else:
        basis = BASES[kind]
        matrix = np.full((len(basis),) * 2, even)
        matrix += np.diag(0.5 / basis.projected_solid_angle)
        path.write_text(xml("Columns", {"tb": " ".join(f"{v:.8g}" for v in matrix.ravel())}, kind))
    return path


@pytest.mark.parametrize("kind", ["TensorTree4", "LBNL/Klems Full"])
def test_a_straight_through_peak_becomes_a_view(tmp_path, kind):
    path = peaked(tmp_path, kind)
    bsdf = load(path)
    assert bsdf.has_view
    assert mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
    w = np.concatenate([vector(35, 60)[None], -vector(70, 10)[None], random_directions(50)])
    tau = bsdf.eval_null_transmission(interaction(w, len(w)))[0].numpy()
    np.testing.assert_allclose(tau, 0.5, rtol=1e-5)
    value = bsdf.eval(mi.BSDFContext(), interaction(w, len(w)), as_vector(-w))[0].numpy()
    np.testing.assert_allclose(value, 0.2 / np.pi * np.abs(w[:, 2]), rtol=1e-4)
    bs, weight = draw(bsdf, vector(35, 60), RADIANCE, 100_000)
    straight = (bs.sampled_type.numpy() & int(+mi.BSDFFlags.Null)) > 0
    assert straight.mean() == pytest.approx(0.5 / 0.7, abs=0.01)
    np.testing.assert_allclose(weight[0].numpy(), 0.7, rtol=1e-4)
    back = np.array(bs.wo)[:, straight]
    np.testing.assert_allclose(back, -np.tile(vector(35, 60)[:, None], back.shape[1]), atol=1e-6)


def test_the_peak_can_be_left_in_the_bsdf(tmp_path):
    bsdf = load(peaked(tmp_path), straight_through="off")
    assert not bsdf.has_view
    assert not mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
    _, weight = draw(bsdf, vector(35, 60), RADIANCE, 1000)
    np.testing.assert_allclose(weight[0].numpy(), 0.7, rtol=1e-4)


def test_splitting_a_peak_keeps_the_energy(tmp_path):
    for kind in ("TensorTree4", "LBNL/Klems Full"):
        component = bsdf_file.read(peaked(tmp_path, kind)).components["tb"]
        part = peak.split(component)
        np.testing.assert_allclose(part.rest.albedos() + part.through, component.albedos())
        assert part.share == pytest.approx(0.5 / 0.7)
    even = TensorTree.constant(0.1)
    assert peak.split(even).share == 0


# Files found in the wild


def test_clear_glass_as_klems_is_the_glazing_of_its_transmittance():
    path = skips.data(SHARED / "subramaniam_clear_klems.xml")
    file, bsdf = bsdf_file.read(path), load(path)
    cosines = np.linspace(0, 1, 1025)
    along = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=-1)
    table, _ = file.hemispherical(along)
    glass = mi.load_dict({"type": "glazing", "transmittance": mi.TensorXf(table)})
    w = random_directions(20_000)
    ours, theirs = (
        b.eval_null_transmission(interaction(w, len(w)))[0].numpy() for b in (bsdf, glass)
    )
    # The glazing interpolates where one ring of patches ends and the next begins.
    assert np.isclose(ours, theirs, rtol=1e-4).mean() > 0.98
    assert ours.mean() == pytest.approx(theirs.mean(), rel=1e-3)
    rest = bsdf.eval(mi.BSDFContext(), interaction(w, len(w)), as_vector(-w))[0].numpy()
    np.testing.assert_allclose(rest, 0, atol=1e-6)


PHYSICAL = [
    "bsdfviewer_blinds_20deg_t45", "honeybee_diffuse50_klems", "honeybee_tensortree",
    "ignis_simple_tensor_d2_trans", "ignis_simple_tensor_front_refl",
    "ignis_simple_tensor_spot_trans", "subramaniam_blindsT3", "subramaniam_clear_klems",
    "subramaniam_ven45_klems",
]  # fmt: skip
TWENTY = [(t, (37 * k) % 360) for k, t in enumerate(np.linspace(0.5, 89, 20))]


@pytest.mark.slow
@pytest.mark.parametrize("name", PHYSICAL)
def test_files_are_sampled_well(name):
    path = skips.data(SHARED / f"{name}.xml")
    bsdf = load(path, straight_through="off")
    worst_spread, worst_p, tests = 1.0, 1.0, 0
    for mode in (RADIANCE, IMPORTANCE):
        for angles in TWENTY:
            for side in (1, -1):
                wi = vector(*angles) * [1, 1, side]
                weight = draw(bsdf, wi, mode, 20_000)[1][0].numpy().astype(float)
                if weight.sum() == 0:
                    continue
                worst_spread = max(worst_spread, (weight**2).mean() / weight.mean() ** 2)
                worst_p, tests = (
                    min(worst_p, chi_square(bsdf, wi, mode, 100_000, inner=300)),
                    tests + 1,
                )
    print(f"{name}: E[w²]/E[w]² ≤ {worst_spread:.4f}; χ²: least p {worst_p:.3g} of {tests}")
    assert worst_spread < 1.3
    assert worst_p > 1 - (1 - 1e-3) ** (1 / tests)


# Hooks


@pytest.mark.parametrize("missing", [(), ("tb",)], ids=["all", "no tb"])
@pytest.mark.parametrize("kind", ["TensorTree4", "TensorTree3", "LBNL/Klems Quarter"])
def test_plugins_and_their_lobes_have_the_hooks_that_are_declared(tmp_path, kind, missing):
    bsdf = load(write(tmp_path, kind, missing))
    assert isinstance(bsdf, MeasuredHooks)
    for mode in (RADIANCE, IMPORTANCE):
        assert isinstance(bsdf._make(mode), Lobes)
