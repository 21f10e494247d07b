"""A room of 4 × 5 × 3 m behind one pane, lit here and by `rtrace`: mean E of nine points.

Random numbers of `rtrace` follow from the second in which it starts, so that each run of the tests
draws anew: bounds hold for all comparisons of a module together.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from drcmitsuba.annual import simulation
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests import radiance

PLACES = [(x, y, 0.8) for x in (1, 2, 3) for y in (1, 2.5, 4)]
"""Points that look up [m]."""
REFLECTANCES = {"floor": 0.2, "wall": 0.5, "ceil": 0.8}
SHAPES = """
floor polygon f 0 0 12 0 0 0  4 0 0  4 5 0  0 5 0
ceil polygon c 0 0 12 0 0 3  0 5 3  4 5 3  4 0 3
wall polygon n 0 0 12 0 5 0  4 5 0  4 5 3  0 5 3
wall polygon e 0 0 12 4 0 0  4 0 3  4 5 3  4 5 0
wall polygon w 0 0 12 0 0 0  0 5 0  0 5 3  0 0 3
wall polygon s 0 0 30 0 0 0  0 0 3  4 0 3  4 0 0  0 0 0
    0.5 0 0.9  3.5 0 0.9  3.5 0 2.5  0.5 0 2.5  0.5 0 0.9
pane polygon p 0 0 12 0.5 0 0.9  0.5 0 2.5  3.5 0 2.5  3.5 0 0.9
"""
SKY = "void glow g 0 0 4 1 1 1 0\ng source s 0 0 4 0 0 1 180\n"
"""Sky of radiance 1."""
FALSE_ALARMS = 1e-3
"""Probability that noise alone lets any comparison of a module fail."""


def room(pane: str, specularity: float = 0.0) -> str:
    """Scene of Radiance: surfaces that mirror a share [–], and the material of the pane."""
    surfaces = (f"void plastic {k} 0 0 5 {3 * f'{rho} '}{specularity} 0" for k, rho in
                REFLECTANCES.items())  # fmt: skip
    return "\n".join([*surfaces, pane, SHAPES])


def sun(direction: np.ndarray) -> str:
    """Sun of radiance 1 and half a degree."""
    x, y, z = direction
    return f"void light l 0 0 3 1 1 1\nl source s 0 0 4 {x} {y} {z} 0.5\n"


def by_rtrace(folder: Path, scene: str, runs: int, options: str) -> np.ndarray:
    """Mean E of the places [W/m²], shape (run,).

    One process makes all runs, as its random numbers follow from the number of the ray.
    """
    (folder / "lit.rad").write_text(scene)
    (folder / "lit.oct").write_bytes(radiance.run(["oconv", "lit.rad"], folder))
    rays = "".join(f"{x} {y} {z} 0 0 1\n" for x, y, z in PLACES) * runs
    command = ["rtrace", "-h", "-I", "-ov", "-aa", "0", "-as", "0", *options.split(), "lit.oct"]
    out = radiance.run(command, folder, rays.encode())
    return np.array(out.split(), float).reshape(runs, len(PLACES), 3)[..., 0].mean(axis=1)


@dataclass(frozen=True)
class Simulated:
    """Light of the places, mean of all of them."""

    sky: np.ndarray
    """E under a sky of radiance 1 [W/m²], shape (replicate,)."""
    suns: np.ndarray
    """E by suns of radiance 1 [W/m²], shape (replicate, sun)."""
    directions: np.ndarray
    """Unit vectors to the suns, shape (sun, 3)."""


def simulated(
    folder: Path, scene: str, times: tuple[str, ...], seeds: int, accuracy: str = ""
) -> Simulated:
    """Light of the room in all replicates of some seeds; `accuracy` has lines of `[accuracy]`."""
    backend.select()
    (folder / "room.rad").write_text(scene)
    (folder / "times.csv").write_text("\n".join(("time", *times)) + "\n")
    (folder / "case.toml").write_text(
        f'[model]\nfiles = ["room.rad"]\n[sensors]\npoints = {[list(p) for p in PLACES]}\n'
        f'[period]\ntimestamps = "times.csv"\n[accuracy]\n{accuracy}\n'
    )
    case, every = load_case(folder / "case.toml"), []
    light = daylight(case)
    for seed in range(seeds):
        one = case.with_tables(accuracy=case.accuracy.model_copy(update={"seed": seed}))
        C = simulation.transport(one, "open", light.suns, light.sky.attrs["latitude"])
        every.append(C["replicates"].values.mean(axis=1))  # (replicate, bin)
    C = np.concatenate(every)
    return Simulated(C[:, 1:146].sum(axis=1), C[:, 146:], np.asarray(light.suns.directions))


def assert_agrees(
    name: str, mine: np.ndarray, theirs: np.ndarray, *, within: float, among: int, noise: float
) -> None:
    """Assert that two means agree but for their noise, and print by how much they differ.

    Parameters
    ----------
    mine, theirs : np.ndarray, shape (run,)
        Independent results of each.
    within : float
        Relative difference that is allowed beside the noise [–].
    among : int
        Number of comparisons of the module: none of them fails by noise, but for a probability of
        `FALSE_ALARMS`, by Šidák's bound and Student's distribution after Welch.
    noise : float
        Largest relative standard error of the difference [–].
    """
    scale = theirs.mean()
    variances = np.array([np.var(x, ddof=1) / len(x) for x in (mine, theirs)]) / scale**2
    free = variances.sum() ** 2 / (variances**2 / (len(mine) - 1, len(theirs) - 1)).sum()
    error, apart = np.sqrt(variances.sum()), mine.mean() / scale - 1
    factor = stats.t.isf((1 - (1 - FALSE_ALARMS) ** (1 / among)) / 2, free)
    print(f"{name}: {100 * apart:+.2f} ± {100 * error:.2f} %")
    assert error < noise, name
    assert abs(apart) < factor * error + within, name
