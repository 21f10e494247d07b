"""Input that `photon_map` refuses, and its messages."""

import drjit as dr
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from tests.unit.plugins.small_scenes import load, tensor
from tests.unit.plugins.test_photon_map import WINDOW, mirrored_scene, photon_map


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"radius": -0.1}, "photon_map: radius: -0.1; give numbers from 0"),
        ({"alpha": 1.5}, "photon_map: alpha: 1.5; give numbers from 0 to 1"),
        ({"passes": 0}, "photon_map: passes: 0; give numbers from 1"),
        ({"max_depth": -2}, "photon_map: max_depth: -2; give numbers from -1"),
        ({"kind": "specular"}, "photon_map: kind: 'specular'; give global or caustic"),
        ({"kernel": "box"}, "photon_map: kernel: 'box'; give epanechnikov or constant"),
        ({"kind": "caustic", "gather": 4}, "photon_map: gather: caustic photons need none"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(RuntimeError, match=message.replace("(", r"\(")):
        photon_map(**parameters)


@pytest.mark.parametrize(
    ("quads", "message"),
    [
        (np.zeros((2, 3, 3)), r"ports: shape \(2, 3, 3\); give \(n, 4, 3\)"),
        (np.zeros((1, 4, 3)), "ports: number 0 is no rectangle"),
        ([WINDOW[0], [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]], "number 1 is no rectangle"),
    ],
)
def test_bad_ports_are_named(quads, message):
    with pytest.raises(RuntimeError, match=message):
        photon_map(ports=tensor(quads))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({}, "neither an environment nor sun_disks"),
        ({"sky": {"type": "constant"}}, "the scene is empty"),
        ({"lamp": {"type": "point", "position": [0, 0, 1]}}, "emitter 'lamp': photons start from"),
    ],
)
def test_scenes_without_light_for_it_are_named(parts, message):
    with pytest.raises(ValueError, match=message):
        photon_map().shoot(load(**parts), 16)


def test_it_has_no_gradients_and_says_so():
    scene = mirrored_scene()
    integrator = photon_map(photons=16)
    with pytest.raises(RuntimeError, match="it has no gradients"):
        integrator.sample(dr.ADMode.Forward, scene, None, None)
