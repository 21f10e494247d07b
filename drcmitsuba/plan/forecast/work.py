"""Work of an evaluation by effect and unit, counted in advance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.groups import OPEN, SHADED, State
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast.pilot import Amount, Pilot
from drcmitsuba.plan.forecast.pilot_paths import spread
from drcmitsuba.plan.forecast.summed import GroupSum, is_summed, states_of_year
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.luminances import sources
from drcmitsuba.sky.sun_models import Suns, mesh
from drcmitsuba.transport.interreflection.cell_rays import EDGE, MOST_BLOCKS
from drcmitsuba.transport.rays.shadow_rays import RIM
from drcmitsuba.transport.sun_interpolation import HELD_OUT

MESH_SUNS = 500
"""Approximate number of suns of an adaptive mesh at its end."""


@dataclass(frozen=True)
class Work:
    """Work of an evaluation, with the pilots from which it follows."""

    plan: Plan
    pilots: dict[State, Pilot] = field(default_factory=dict)
    """Pilot of each simulated state of the shade."""
    amounts: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Number of units of work by effect and unit; units that are kinds of rays count rays."""

    def add(self, amounts: Iterable[Amount], times: float = 1.0, effect: str | None = None) -> None:
        """Add amounts, all to one effect where it is given."""
        for name, unit, amount in amounts:
            self.amounts[effect or name, unit] += times * amount  # type: ignore[assignment]

    @property
    def by_unit(self) -> Counter[str]:
        """Amounts of every unit, in sum over the effects."""
        sums: Counter[str] = Counter()
        for (_, unit), amount in sorted(self.amounts.items()):
            sums[unit] += amount
        return sums

    @cached_property
    def summed(self) -> GroupSum | None:
        """Sum over groups of panes, where the façade takes more states than are simulated."""
        if SHADED not in self.pilots or not is_summed(self.plan):
            return None
        return GroupSum.of(self.plan, self.pilots[OPEN], self.pilots[SHADED])

    @property
    def channels(self) -> int:
        """Number of colour channels that are simulated."""
        return len(LUMINANCE_WEIGHTS) if self.plan.scope.channels else 1

    @property
    def entries(self) -> int:
        """Number of illuminances."""
        return self.plan.facts.hours * len(self.pilots[OPEN].points) * self.channels

    @property
    def sky_bins(self) -> int:
        """Number of bins of sky and ground in the case, simulated or not."""
        return len(Patches(self.plan.facts.case.sky.subdivision))


def work(plan: Plan) -> Work:
    """Count the work of a plan.

    A mesh of suns counts with a typical number of suns. Rounds toward a target are not counted.
    """
    counted = Work(plan)
    suns: Suns | None = plan.facts.light.suns
    for state in (OPEN, SHADED):
        if state == SHADED:
            suns = _suns_behind_shade(plan, counted.pilots[OPEN])
        if suns is None:
            continue
        first = counted.pilots.get(OPEN) if _shares_paths(counted) else None
        pilot = counted.pilots[state] = Pilot.of(plan, state, _followed(plan, suns), first)
        amounts = [*_transport(pilot)]
        if isinstance(plan.facts.case.sun, Adaptive):
            amounts += _adaptive(plan, pilot, state, suns.where(plan.scope.enabled_suns(suns)))
        if state == SHADED and counted.summed is not None:
            amounts = [*counted.summed.amounts()]
        elif state == SHADED and (more := states_of_year(plan) - 2) > 0:
            of_sky = Pilot.of(plan, state, suns.only(()))
            amounts += [(name, unit, more * amount) for name, unit, amount in _transport(of_sky)]
        behind = "shaded_state" if state == SHADED else None
        counted.add(amounts, 1, behind)
        counted.add(amounts, counted.channels - 1, behind or "colour")
    entries = counted.entries * plan.facts.case.accuracy.replicates
    counted.add([("rest", "evaluation", 1), ("rest", "illuminance", entries)])
    counted.add([("pictures", "picture", plan.scope.pictures)])
    return counted


def _shares_paths(counted: Work) -> bool:
    """Whether states share the paths of the first one; colours follow one another in each."""
    plan, first = counted.plan, counted.pilots.get(OPEN)
    alone = counted.channels == 1 and not isinstance(plan.facts.case.sun, Adaptive)
    return first is not None and first.keeps_paths and alone and not is_summed(plan)


def _suns_behind_shade(plan: Plan, pilot: Pilot) -> Suns | None:
    """Suns of the time stamps at which the pilot's sensors close the shade; None without any."""
    every, case = plan.facts.light.every, plan.simulated
    sky = every.sky
    if not plan.scope.shade or not len(prepared(case).groups):
        return None
    if any(group.schedule is not None for group in case.groups.values()):
        return plan.facts.light.suns
    threshold, area = case.shade_rule
    normal = sky["direct_normal_illuminance"].values
    closes = (normal > 0) | plan.scope.every_shade
    if not plan.scope.every_shade:
        E = normal[closes] * pilot.sunlit(every.sun["direction"].values[closes])
        closes[closes] = (threshold <= E).mean(axis=0) >= area
    return plan.facts.light.suns.only(sources(sky.isel(time=closes))) if closes.any() else None


def _followed(plan: Plan, suns: Suns) -> Suns:
    """Suns that are simulated; typical suns of a mesh where the sun is adaptive."""
    if isinstance(plan.facts.case.sun, Adaptive):
        possible = mesh.possible_suns(plan.facts.light.sky.attrs["latitude"])
        at = spread(len(possible), MESH_SUNS + HELD_OUT)
        labels = tuple(f"{mesh.PREFIX}{i}" for i in range(len(at)))
        suns = Suns(labels, possible[at], suns.diameter, straight=False)
    return suns.where(plan.scope.enabled_suns(suns))


def _adaptive(plan: Plan, pilot: Pilot, state: State, suns: Suns) -> Iterator[Amount]:
    """Work of an adaptive sun: paths for each level of the mesh; straight light of all suns."""
    levels = plan.simulated.sun.finest - mesh.COARSEST if state == OPEN else 0  # type: ignore[union-attr]
    yield "suns", "path", levels * pilot.count * pilot.paths.rays
    yield "suns", "shadow", RIM * len(pilot.points) * len(suns.labels)
    yield "suns", "entry", len(pilot.points) * len(suns.labels)


def _transport(pilot: Pilot) -> Iterator[Amount]:
    """Work of one call of `coefficients.compute`."""
    if not any(pilot.bins):
        return
    yield from pilot.rays()
    a, n, cells, bins = pilot.accuracy, len(pilot.points), pilot.cells, sum(pilot.bins)
    of_group = cells / pilot.groups
    yield "interreflection", "product", a.replicates * n * of_group * bins
    if pilot.scene.effects.solved_cells:
        blocks = min(of_group / EDGE**2, MOST_BLOCKS)
        yield "solved_cells", "product", a.replicates * cells * blocks * bins
    yield "interreflection", "deposit", a.replicates * cells * bins
    yield "rest", "entry", a.replicates * n * bins
    yield "rest", "launch", a.replicates * pilot.blocks
    yield "films", "product", a.replicates * pilot.film_products
    yield "films", "film_sun", pilot.film_values
