"""Straight sun by tiles that are cut into panes, against evaluations of built façades."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import evaluate
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.realise import realise
from drcmitsuba.runtime import backend
from tests.tiled_room import MATERIALS, PLAIN, room

DESIGN = {"side": "south", "film": "fabric", "clear": "glass", "rows": 2, "segments": 2}
SHINY = {"type": "glazing", "transmittance": 0.3, "reflectance": 0.6}
FEW = {
    "paths": 16,
    "sensor_sky_rays": 16,
    "cell_sky_rays": 16,
    "replicates": 2,
    "sensor_sun_samples": 64,
}


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def layout(**changes):
    """Two rows of two tiles, sensors all over the floor; tiles mirror no suns."""
    sensors = {"corner": [0.0, 0.0, 0.4], "count": [8, 10], "spacing": 0.5}
    dull = {**MATERIALS, "glass": {**MATERIALS["glass"], "reflectance": 0.0}, "shiny": SHINY}
    tables = {"design": DESIGN, "accuracy": FEW, "sensors": sensors, "materials": dull}
    return Layout.of(room(PLAIN, **tables | changes))


def mixed(year, seed):
    """Composition of wall, glass and fabric in every tile, none of them with less than a tenth."""
    share = np.zeros((len(year.tiles), len(year.materials)), np.float32)
    columns = [year.materials.index(name) for name in ("wall", "glass", "fabric")]
    share[:, columns] = 0.1 + 0.7 * np.random.default_rng(seed).dirichlet(np.ones(3), len(share))
    return share


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="one side"),
        pytest.param(
            {
                "room": {"size": [4.0, 5.0, 3.0], "rotation": 30.0},
                "facade": {"south": {"segments": 2, "strips": PLAIN}, "west": {"strips": PLAIN}},
            },
            id="turned, two sides", marks=pytest.mark.slow,
        ),
        pytest.param(
            {
                "facade": {
                    "south": {"segments": 2, "strips": PLAIN},
                    "east": {"strips": [{"bottom": 0.4, "top": 2.9, "material": "shiny"}]},
                },
                "period": {"months": [1], "hours": [9, 16]},
            },
            id="beside a mirroring side",
        ),
    ],
)  # fmt: skip
def test_the_sun_is_that_of_the_built_façade(changes):
    one = layout(**changes)
    year = one.year()
    for seed in range(2):
        share = mixed(year, seed)
        tensor = mi.TensorXf(share)
        E = year.illuminance(tensor)
        ours, blended = (e.direct.numpy() for e in (year.built(tensor, E), E))
        case = realise(one.case, one.side, year.tiles, share, year.materials, one.film)
        alone = evaluate(case).illuminance["direct_sun"].transpose("time", "sensor").values
        assert alone.max() > 1e4
        # The sun may be cut by an edge, of which samples see this much or that.
        sunlit = [e > 1000 for e in (ours, alone, blended)]
        assert (sunlit[0] != sunlit[1]).mean() < 0.003
        assert (sunlit[2] != sunlit[1]).mean() > 0.03
        assert ours.mean() == pytest.approx(alone.mean(), rel=0.005)
        assert np.abs(ours - alone).mean() < 0.015 * alone.mean()


def test_some_hours_are_hours_of_all():
    year = layout().year()
    share = mi.TensorXf(mixed(year, 5))
    hours = np.arange(3, len(year.months), 7)
    some, every = (
        of.built(share, of.illuminance(share)).direct.numpy() for of in (year.at(hours), year)
    )
    np.testing.assert_allclose(some, every[hours], rtol=1e-6)


def test_whole_tiles_and_transmittances_are_those_of_the_mix():
    year = layout().year()
    share = np.zeros((4, len(year.materials)), np.float32)
    share[
        range(4), [year.materials.index(name) for name in ("glass", "wall", "fabric", "glass")]
    ] = 1
    tensor, scale = mi.TensorXf(share), {"glass": mi.Float(0.5)}
    E = year.illuminance(tensor, scale)
    np.testing.assert_allclose(
        year.built(tensor, E, scale).direct.numpy(), E.direct.numpy(), rtol=1e-4, atol=0.1
    )
