"""Cost of light by tile, and of compositions and their derivatives after it.

`python -m tests.bench.facade [WEATHER]`: the paper's classroom, cut into few tiles and into many.
"""

import sys
import time
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba import load_case
from drcmitsuba.design.facade_tiles import TiledLight
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.runtime import backend
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.tiled_facades import TiledFacades
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import elements

CUTS = [(3, 1), (27, 1), (6, 6)]


def fastest(function, times=7):
    """Seconds of the fastest of several runs."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        function()
        dr.sync_thread()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def by_tile(case, light, heights, segments, kept):
    """Light of the classroom by tile, of wall, glass and film."""

    fills, suns = ("wall", "glass", "film"), light.suns
    tiled = TiledFacades.of_grid(case, "south", heights, segments, fills)
    lit = elements.compute(tiled.case, tiled.panes, suns, case.accuracy, ALL_EFFECTS, kept=kept)
    return TiledLight.of(tiled, segments * (len(heights) - 1), (lit,))


def main():
    backend.select()
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    case = load_case("classroom/reference/o3").with_weather(file)
    light = daylight(case)
    print("tiles  light s   MB  C s    E s    E and 1 reverse pass s  ratio")
    for rows, segments in CUTS:
        heights = np.linspace(0.9, 3.6, rows + 1)
        start = time.perf_counter()
        tiled = by_tile(case, light, heights, segments, kept=1)
        seconds = time.perf_counter() - start
        year, size = FacadeYear.of(tiled, light), tiled.channels[0].nbytes / 2**20
        tiles, names = tiled.tiles, tiled.materials
        del tiled
        share = np.zeros((len(tiles), len(names)), np.float32)
        share[:, :3] = np.random.default_rng(1).dirichlet(np.ones(3), len(tiles))

        def primal(year=year, share=share):
            E = year.illuminance(mi.TensorXf(share))
            dr.eval(dr.mean(E.open.array) + dr.mean(E.shaded.array) + dr.mean(E.direct.array))

        def reverse(year=year, share=share):
            x = mi.TensorXf(share)
            dr.enable_grad(x)
            E = year.illuminance(x)
            dr.backward(dr.mean(E.open.array) + dr.mean(E.shaded.array) + dr.mean(E.direct.array))
            dr.eval(dr.grad(x))

        def recombined(year=year, share=share):
            shares = dr.concat((mi.Float(share.ravel()), year.still))
            dr.eval(*year.channels[0][1].coefficients(shares, dr.ones(mi.Float, len(year.names))))

        c, e, g = fastest(recombined), fastest(primal), fastest(reverse)
        print(
            f"{len(tiles):5d} {seconds:8.1f} {size:5.0f} {c:6.3f} {e:6.3f} {g:12.3f} {g / e:16.1f}"
        )


if __name__ == "__main__":
    main()
