"""Cost of a façade basis, and of compositions and their derivatives after it.

`python -m tests.bench.facade [WEATHER]`: the paper's classroom, cut into few tiles and into many.
"""

import sys
import time
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import facade_basis

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


def main():
    backend.select()
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    case = load_case("classroom/reference/o3").with_weather(file)
    light = daylight(case)
    print("tiles  basis s   MB  C s    E s    E and 1 reverse pass s  ratio")
    for rows, segments in CUTS:
        wall = facade_basis.Wall(case, "south")
        heights = np.linspace(0.9, 3.6, rows + 1)
        tiles, palette = facade_basis.of_grid(wall, heights, segments, ("wall", "glass", "film"))
        start = time.perf_counter()
        basis = facade_basis.compute(wall, tiles, palette, light.suns, case.accuracy, groups=1)
        seconds = time.perf_counter() - start
        year, size = facade_basis.BasisYear.of(basis, light), basis.nbytes / 2**20
        del basis
        share = np.zeros((len(tiles), len(palette.names)), np.float32)
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
            dr.eval(*year.coefficients(mi.TensorXf(share)))

        c, e, g = fastest(recombined), fastest(primal), fastest(reverse)
        print(
            f"{len(tiles):5d} {seconds:8.1f} {size:5.0f} {c:6.3f} {e:6.3f} {g:12.3f} {g / e:16.1f}"
        )


if __name__ == "__main__":
    main()
