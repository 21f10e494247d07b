"""Statistics of the parts of C over replicates that come in several launches."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.transport.coefficient_arrays import PARTS, Bins, Statistics
from drcmitsuba.transport.light.irradiance import Irradiance

SENSORS, SKY, SUNS = 2, 3, 2


@pytest.mark.parametrize("more", [(), (0,), (2,), (0, 1), (1, 2), (0, 1, 2)])
def test_direct_light_may_be_straight_light_in_some_launches_only(more):
    """Direct light of a launch that meets no film is the very object that straight light is."""
    backend.select()
    rng, statistics, values = np.random.default_rng(3), Statistics(), {name: [] for name in PARTS}
    for launch in range(3):
        light = {name: rng.random((2, SENSORS, SKY + SUNS)).astype(np.float32) for name in PARTS}
        if launch not in more:
            light["direct"] = light["straight"]
        irradiance = {name: halves(array) for name, array in light.items()}
        if launch not in more:
            irradiance["direct"] = irradiance["straight"]
        statistics.add(irradiance, 2)
        for name, array in light.items():
            values[name].append(array)
    arrays = statistics.arrays(SENSORS, Bins.of([f"bin_{i}" for i in range(SKY + SUNS)]))
    for name, parts in values.items():
        every = np.concatenate(parts)
        error = every.std(axis=0, ddof=1) / np.sqrt(len(every))
        np.testing.assert_allclose(arrays[name], every.mean(axis=0), rtol=1e-5)
        np.testing.assert_allclose(arrays[f"{name}_se"], error, rtol=1e-3)


def halves(values):
    """Light (replicate, sensor, bin) of sky and suns."""
    parts = (part.reshape(-1, part.shape[-1]) for part in np.split(values, [SKY], axis=-1))
    return Irradiance(*(mi.TensorXf(np.ascontiguousarray(part)) for part in parts))
