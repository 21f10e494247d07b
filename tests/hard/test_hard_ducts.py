"""Long mirrored ducts: what they carry, what they lose, and what is said of it."""

import json
from dataclasses import asdict
from functools import reduce

import numpy as np
import pytest

from drcmitsuba import plan
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.transport.photons.light import FluxLedger
from drcmitsuba.transport.photons.paths import OFFSET
from drcmitsuba.transport.photons.tracer import PhotonTracer
from tests.validation import unfolded_duct


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


# --- a duct a hundred times as long as it is wide


WIDTH, LENGTH, RHO = 0.1, 10.0, 0.98


def duct_case():
    """A room under a square mirrored pipe, and the suns that look down it."""
    pipe = {"type": "lightpipe", "centre": [2, 2], "width": WIDTH, "sides": 4, "height": LENGTH}
    black = dict.fromkeys(("floor", "walls", "ceiling"), 0.0)
    return Case.model_validate(
        {
            "room": {"size": [4, 4, 3], **black},
            "materials": {"silver": {"type": "mirror", "reflectance": RHO}},
            "components": {"pipe": {**pipe, "mirror": "silver"}},
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [1, 1]},
        }
    )


def traced(sun, surfaces, photons=1 << 15):
    """Ledgers of replicates of the pipe's photons from one sun."""
    case = duct_case()
    points, normals = sensor_points(case)
    settings = Accuracy(photons=photons, photon_surfaces=surfaces)
    tracer = PhotonTracer.of(scene.load(case), points, normals, sun[None], 0.5, None, settings)
    return [tracer.traced(seed).ledgers["pipe sun"] for seed in range(12)]


@pytest.mark.parametrize(
    "beam", [(0.13, 0.08, 1.0), pytest.param((0.4, -0.75, 1.0), marks=pytest.mark.slow)]
)
def test_duct_of_1_to_100(holds, beam):
    """Up to 115 mirrors in turn, each met a little early: rays start δ off the one before.

    Of n mirrors the beam meets n δ/w more at most, and each of them takes 1 − ρ. By Mitsuba's own
    δ, 1.3 mm at the upper end, 2 % of the light were missing.
    """
    d = np.array(beam) / np.linalg.norm(beam)
    aspect = LENGTH / WIDTH
    exact = unfolded_duct.disk(np.array(beam), 0.5, aspect, RHO)
    ledgers = traced(np.array([-d[0], -d[1], d[2]]), surfaces=1000)
    through = np.array([(f.landed + f.others) / f.emitted for f in ledgers])
    lost = max(f.lost / f.emitted for f in ledgers)
    out = [f.landed + f.absorbed + f.escaped + f.others + f.lost for f in ledgers]
    into = [f.emitted + f.roulette for f in ledgers]
    holds("flux in = flux out", abs(np.divide(out, into) - 1), 1e-5)
    holds("what is lost after 1000 surfaces", lost, 0)
    mirrors = aspect * (abs(beam[0]) + abs(beam[1]))
    offset = mirrors * (1 - RHO) * OFFSET * (1 + 3 + LENGTH) / WIDTH
    error = through.std(ddof=1) / len(through) ** 0.5 / exact
    off = abs(through.mean() / exact - 1)
    holds("transmittance = that of the unfolded duct", off, offset + 5 * error)
    holds("its relative standard error", error, 0.003)


def test_a_note_says_what_a_long_duct_loses(holds):
    """Given up after 20 of 41 mirrors: what is still under way is the flux with ρ²⁰ of it left."""
    d = np.array([0.2, 0.21, 1.0])
    d /= np.linalg.norm(d)
    ledgers = traced(np.array([-d[0], -d[1], d[2]]), surfaces=20)
    lost = np.array([f.lost / f.emitted for f in ledgers])
    # The disk's rays meet 39 to 43 mirrors. Points are right to some 4 · 2⁻²⁴ of 14 m: as close to
    # an edge of the duct, a photon may slip between two walls.
    holds("lost = ρ²⁰", abs(lost / RHO**20 - 1), 20 * 4 * 2**-24 * 14 / WIDTH)
    total = reduce(FluxLedger.plus, ledgers)
    (note,) = plan.light_notes({"photons": json.dumps({"pipe sun": asdict(total)})})
    assert "67 % of the light from the sun was still under way" in note
    assert "raise accuracy.photon_surfaces" in note
