"""Virtual goniophotometer: a recipe traced from every incident cell, from both sides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.bsdf_text import DIGITS
from drcmitsuba_plugins.energy import sum_of_albedos
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.bsdf.merge import merge
from drcmitsuba.goniophotometer.trace import prepare, shares
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene.structures.recipe import Recipe
from drcmitsuba.scene.structures.structure import unit_cell

DEEPEST = {3: 7, 4: 6}
"""Largest number of levels of a tree, by its rank."""
MOST_SAMPLES = 1 << 21
"""Largest number of rays per incident cell."""
MOST_LOST = 0.01
"""Largest share of the light that may still be inside after thousands of surfaces."""
MOST_SENT, STEP = 1.02, 10.0
"""Largest T + R of an incidence after cells are merged; else so many percent of the merges less."""

_SIDES = ((-1, "tb", "rb"), (1, "tf", "rf"))
"""Side of the incident light, −1 outside and 1 room; its transmission and reflection."""


@dataclass(frozen=True)
class Exposure:
    """All cells of the four components, traced twice."""

    rank: int
    depth: int
    """Rank and levels of the trees."""
    samples: int
    """Number of rays per incident cell, both halves together."""
    halves: dict[str, np.ndarray]
    """Shares of the light of an incident cell that leave through an outgoing cell, for `tb`, `rb`,
    `tf`, `rf`, from two independent halves of the rays, shape (2, incident, n²). n = 2ᵈᵉᵖᵗʰ;
    incident cells are the n² cells of the square for rank 4, n/2 rings from grazing to normal for
    rank 3."""
    lost: float
    """Share of the light that never left the structure."""

    def shares(self, name: str) -> np.ndarray:
        """Shares of the light by incident and outgoing cell, shape (incident, n²)."""
        return np.mean(self.halves[name], axis=0, dtype=float)

    def errors(self, name: str) -> np.ndarray:
        """Binomial standard errors of `shares`, (incident, n²); upper bound for stratified rays."""
        p = self.shares(name)
        return np.sqrt(np.clip(p * (1 - p), 0, None) / self.samples)

    def hemispherical(self, name: str) -> np.ndarray:
        """Transmittance or reflectance of every incident cell, by halves, shape (2, incident)."""
        return self.halves[name].sum(axis=2, dtype=float)

    @property
    def unit(self) -> float:
        """Value that one ray adds to f of a cell [1/sr]."""
        return float(4**self.depth / np.pi / self.samples)

    def tree(self, name: str) -> TensorTree:
        """Full tree of f = Φ_out / (Φ_in π h²) [1/sr] with h the side of a cell."""
        n = 1 << self.depth
        f = self.shares(name) * (n * n / np.pi)
        if self.rank == 4:
            return TensorTree.of_grid(f.reshape(n, n, n, n))
        rings = f.reshape(n // 2, n, n)
        return TensorTree.of_grid(np.concatenate([rings, np.zeros_like(rings)]))


def _check(name: str, value: int, low: int, high: int) -> None:
    """Refuse an argument that is not a whole number from low to high."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        got = f"got {value!r}"
        raise InputError("goniophotometer", name, got, f"give a whole number, {low} to {high}")


def expose(
    recipe: Recipe, *, depth: int = 5, rank: int = 4, samples: int = 4096, seed: int = 0,
    progress: Progress = lambda share: None,
) -> Exposure:  # fmt: skip
    """Trace all cells of a recipe; the parameters are those of `measure`.

    Raises
    ------
    InputError
        The recipe's geometry or an argument is unfit, or light is trapped in the structure.
    """
    if rank not in DEEPEST:
        raise InputError("goniophotometer", "rank", f"got {rank!r}", "give 3 (isotropic) or 4")
    _check("depth", depth, 1, DEEPEST[rank])
    _check("samples", samples, 16, MOST_SAMPLES)
    _check("seed", seed, 0, 1 << 16)
    backend.select()
    cell = prepare(unit_cell(recipe))
    halves: dict[str, np.ndarray] = {}
    lost_shares = []
    for side, (sign, through, back) in enumerate(_SIDES):
        pair = []
        for turn in (2 * side, 2 * side + 1):
            traced, lost = shares(
                cell, sign, rank=rank, depth=depth, samples=samples // 2, seed=4 * seed + turn,
                progress=part(progress, turn / 4, (turn + 1) / 4),
            )  # fmt: skip
            pair.append(traced)
            lost_shares.append(lost)
        halves[through], halves[back] = (np.stack([p[i] for p in pair]) for i in range(2))
    if max(lost_shares) > MOST_LOST:
        got = f"{max(lost_shares):.1%} of the light does not leave it again"
        raise InputError(recipe.source, "structure", got, "check that its surfaces are closed")
    return Exposure(rank, depth, samples // 2 * 2, halves, float(np.mean(lost_shares)))


def _rounded(tree: TensorTree) -> TensorTree:
    """Round values to the digits of a file, so that it reads back equal."""
    return replace(tree, value=np.array([float(f"{v:.{DIGITS}g}") for v in tree.value]))


def _merged(exposure: Exposure, percent: float) -> tuple[dict[str, TensorTree], float]:
    """Trees of all components, and the share of the merges [%] that keeps T + R of incidences."""
    while True:
        trees = {
            name: _rounded(merge(exposure.tree(name), percent=percent, unit=exposure.unit))
            for name in exposure.halves
        }
        sides = (sum_of_albedos([trees[f"t{side}"], trees[f"r{side}"]]) for side in "fb")
        if percent == 0 or max(float(side.max()) for side in sides) <= MOST_SENT:
            return trees, percent
        percent = max(0.0, percent - STEP)


def measure(
    recipe: Recipe, *, depth: int = 5, rank: int = 4, samples: int = 4096, seed: int = 0,
    progress: Progress = lambda share: None, percent: float = 90.0,
) -> BsdfFile:  # fmt: skip
    """Measure a recipe from both sides: all four components as trees of variable resolution.

    Parameters
    ----------
    recipe : Recipe
        Result of `load_recipe`.
    depth : int
        Levels of the tree: cells of side 2⁻ᵈᵉᵖᵗʰ, projected solid angle π 4⁻ᵈᵉᵖᵗʰ sr. At most 6
        (rank 4) or 7 (rank 3).
    rank : int
        4, or 3 to average over azimuths, for structures that look the same from all of them.
    samples : int
        Number of rays per incident cell.
    seed : int
        Seed of the random numbers, 0 to 65536.
    progress : callable, optional
        Called with the share of the work that is done, 0 to 1.
    percent : float
        Least share of the possible merges of cells that is made [%]. It is lowered where merged
        incidences would send out more than 102 % of the light.

    Returns
    -------
    BsdfFile
        Values f [1/sr], means over pairs of an incident and an outgoing cell. Its notes hold
        the settings and the recipe.

    Raises
    ------
    InputError
        The recipe's geometry or an argument is unfit, or light is trapped in the structure.

    Notes
    -----
    Limits: geometrical optics (structures much larger than the wavelength), no dispersion, no
    absorption in clear material. The two polarisations are averaged at each surface, so T of an
    acrylic slab is 0.3 % low at 45° of incidence, 1.3 % at 60°, 2.8 % at 70°. Cells blur peaks
    to their own size. Rank 4 at depth 6 takes about 2 GB of memory.

    Examples
    --------
    >>> from drcmitsuba import goniophotometer
    >>> recipe = goniophotometer.load_recipe("lamellae.toml")
    >>> coarse = goniophotometer.measure(recipe, depth=2, rank=3, samples=16)
    >>> sorted(coarse.components)
    ['rb', 'rf', 'tb', 'tf']
    """
    if not 0 <= percent <= 100:
        raise InputError("goniophotometer", "percent", f"got {percent!r}", "give 0 to 100")
    exposure = expose(recipe, depth=depth, rank=rank, samples=samples, seed=seed, progress=progress)
    trees, merged = _merged(exposure, percent)
    notes = (
        f"drcmitsuba goniophotometer: rank {rank}, depth {depth}, {exposure.samples} rays per "
        f"incident cell and side, seed {seed}, {merged:g} % of the merges",
        recipe.model_dump_json(exclude_none=True),
        *[f"{percent:g} % of the merges would send out more than all light"] * (merged < percent),
    )
    return BsdfFile(
        source=recipe.source, name=recipe.name, manufacturer=recipe.manufacturer,
        kind=f"TensorTree{rank}", components=dict(trees), notes=notes,
    )  # fmt: skip
