"""BSDF plugins asked for what is no direction: they return 0 and read no memory but their own.

A read outside a table kills the process, so the plugins with tables are asked in another one.
"""

import subprocess
import sys

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from tests import ROOT
from tests.unit.plugins.measured_files import write

MEASURED = {
    "rank 4": ("tensor_tree", "TensorTree4", ()),
    "rank 3": ("tensor_tree", "TensorTree3", ()),
    "rank 3 by reciprocity": ("tensor_tree", "TensorTree3", ("tb",)),
    "klems": ("klems", "LBNL/Klems Full", ()),
}
"""Plugin, kind of file, missing components."""
OTHERS = {
    "fine film": {"type": "tensor_tree", "filename": str(ROOT / "scenes" / "films" / "prism.xml")},
    "glazing": {"type": "glazing", "transmittance": 0.7, "reflectance_front": 0.1},
    "diffuser": {"type": "diffuser", "transmittance": 0.3, "reflectance_front": 0.2},
    "fabric": {"type": "diffuser", "transmittance": 0.3, "straight": 0.2},
    "coated_mirror": {"type": "coated_mirror", "reflectance": 0.9, "ior": 1.5},
    "polished": {"type": "polished", "mirrored": 0.1, "matt": 0.5},
    "redirecting_film": {"type": "redirecting_film", "transmittance": 0.7},
}
WITH_TABLES = [*MEASURED, "fine film", "glazing"]
WITHOUT_TABLES = [name for name in OTHERS if name not in WITH_TABLES]
WITH_UP = [*MEASURED, "fine film", "redirecting_film"]
"""Plugins whose answer depends on how the pane stands in the world."""
UNIT = (0.3, 0.4, 0.75**0.5)
NAN, INFINITE, ZERO = (np.nan,) * 3, (np.inf,) * 3, (0.0,) * 3


def parameters(name, folder):
    if name in OTHERS:
        return OTHERS[name]
    plugin, kind, missing = MEASURED[name]
    return {"type": plugin, "filename": str(write(folder, kind, missing))}


def vector(w):
    return mi.Vector3f(*(mi.Float([float(x)]) for x in w))


def interaction(wi, frame=True):
    """One lane; without `frame`, its shading frame is zero."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    if frame:
        si.n = mi.Normal3f(0, -1, 0)
        si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 0, 1), si.n)
    si.wi = vector(wi)
    return si


def answers(bsdf, si, wo):
    """Values, densities, weights and straight transmittances in both transport modes."""
    for mode in (mi.TransportMode.Radiance, mi.TransportMode.Importance):
        ctx = mi.BSDFContext(mode)
        for direction in (wo, mi.Vector3f(wo.x, wo.y, -wo.z)):
            value, density = bsdf.eval_pdf(ctx, si, direction)
            yield from (value[0], density)
            yield from (bsdf.eval(ctx, si, direction)[0], bsdf.pdf(ctx, si, direction))
    yield bsdf.eval_null_transmission(si)[0]


def weights(bsdf, si):
    for mode in (mi.TransportMode.Radiance, mi.TransportMode.Importance):
        for u in (0.02, 0.5, 0.98):
            _, weight = bsdf.sample(mi.BSDFContext(mode), si, mi.Float([u]), mi.Point2f(0.3, 0.6))
            yield weight[0]


def check(name, folder):
    """Every answer for an undefined direction is 0; a frame of zeros hides where `up` is."""
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    bsdf = mi.load_dict(parameters(name, folder))
    undefined = [interaction(w) for w in (NAN, INFINITE, ZERO, (*UNIT[:2], np.nan))]
    if name in WITH_UP:
        undefined += [interaction(w, frame=False) for w in (UNIT, NAN)]
    for si in undefined:
        for got in [*answers(bsdf, si, vector(UNIT)), *weights(bsdf, si)]:
            assert np.all(got.numpy() == 0), (name, si.wi, got)
        if hasattr(bsdf, "leaf"):
            assert bsdf.leaf(si, vector(UNIT)).numpy() == 0
    for wo in (NAN, INFINITE, ZERO):
        *values, _ = answers(bsdf, interaction(UNIT), vector(wo))
        assert all(np.all(got.numpy() == 0) for got in values), (name, wo)
    assert any(got.numpy()[0] > 0 for got in weights(bsdf, interaction(UNIT)))


def check_all_with_tables(folder):
    """The name of each plugin goes to stdout before it is asked: a crash leaves it there."""
    for name in WITH_TABLES:
        print(name, flush=True)
        check(name, folder)


def test_undefined_directions_give_0_and_read_no_other_memory(tmp_path):
    module = "tests.unit.plugins.test_undefined_directions"
    command = (
        f"import pathlib; from {module} import check_all_with_tables as check; "
        f"check(pathlib.Path({str(tmp_path)!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    last = done.stdout.split("\n")[-2:]
    assert done.returncode == 0, f"exit {done.returncode} at {last}: {done.stderr[-2000:]}"


@pytest.mark.parametrize("name", WITHOUT_TABLES)
def test_undefined_directions_give_0(name, tmp_path):
    check(name, tmp_path)


@pytest.mark.parametrize("name", [*MEASURED, *OTHERS])
def test_an_interaction_that_was_given_no_frame_works_or_is_refused_in_one_line(name, tmp_path):
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    made = parameters(name, tmp_path)
    bsdf, si = mi.load_dict(made), mi.SurfaceInteraction3f()
    si.wi = vector(UNIT)
    if name not in WITH_UP:  # as Mitsuba's own
        assert np.isfinite(bsdf.eval(mi.BSDFContext(), si, vector(UNIT))[0].numpy()).all()
        return
    with pytest.raises(ValueError, match=f"^{made['type']}: the surface interaction has no") as e:
        bsdf.eval(mi.BSDFContext(), si, vector(UNIT))
    assert "\n" not in str(e.value)


def test_an_undefined_direction_takes_a_bin_of_the_sky():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    sky = mi.load_dict({"type": "tregenza_sky"})
    for w in (NAN, INFINITE, ZERO):
        assert sky.bin_of(vector(w)).numpy() < sky.bin_count
        assert np.isfinite(sky.eval(interaction(w))[0].numpy()).all()


@pytest.mark.parametrize("name", OTHERS)
def test_masks_of_the_caller_stay_as_they_were(name, tmp_path):
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    bsdf, active = mi.load_dict(parameters(name, tmp_path)), mi.Bool([True])
    si, ctx = interaction((1.0, 0.0, 0.0)), mi.BSDFContext()
    bsdf.eval_pdf(ctx, si, vector(UNIT), active)
    bsdf.sample(ctx, si, mi.Float([0.5]), mi.Point2f(0.3, 0.6), active)
    bsdf.eval_null_transmission(si, active)
    assert active.numpy().all()
