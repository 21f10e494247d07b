"""Work of an evaluation by effect and unit, counted in advance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast.pilot import Amount, Pilot, spread
from drcmitsuba.runtime.ray_counter import KINDS
from drcmitsuba.scene.surfaces import State
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import sources
from drcmitsuba.sky.sun_models import Suns, mesh
from drcmitsuba.transport.sun_interpolation import HELD_OUT

MESH_SUNS = 500
"""Approximate number of suns of an adaptive mesh at its end."""
REFLECTIONS = 4
"""Number of reflections from pane to pane."""
LIT = 0.7
"""Part of the cells that a bin lights directly."""
METRICS = 2
"""Number of accumulations of E: once for E itself, once for the draws of the metrics."""


@dataclass
class Work:
    """Amounts of work by effect and unit; units that are kinds of rays count rays."""

    amounts: dict[tuple[str, str], float] = field(default_factory=lambda: defaultdict(float))

    def add(self, amounts: Iterable[Amount], times: float = 1.0, effect: str | None = None) -> None:
        """Add amounts, all to one effect where it is given."""
        for name, unit, amount in amounts:
            if amount:
                self.amounts[effect or name, unit] += times * amount

    @property
    def by_unit(self) -> dict[str, float]:
        """Amounts of every unit."""
        out: dict[str, float] = defaultdict(float)
        for (_, unit), amount in self.amounts.items():
            out[unit] += amount
        return dict(out)

    @property
    def rays(self) -> dict[str, int]:
        """Number of rays by kind, as `RayCounter` counts them."""
        units = self.by_unit
        return {kind: round(units.get(kind, 0)) for kind in KINDS}


@dataclass(frozen=True)
class Counted:
    """Work of an evaluation, with the pilots from which it follows.

    Parameters
    ----------
    plan : Plan
    work : Work
    pilots : dict of State to Pilot
        Pilot of each simulated state of the shade.
    """

    plan: Plan
    work: Work
    pilots: dict[State, Pilot]

    @property
    def channels(self) -> int:
        """Number of colour channels that are simulated."""
        return len(LUMINANCE_WEIGHTS) if self.plan.scope.channels else 1

    @property
    def entries(self) -> int:
        """Number of illuminances."""
        return self.plan.facts.hours * len(self.pilots["open"].points) * self.channels

    @property
    def sky_bins(self) -> int:
        """Number of bins of sky and ground in the case, simulated or not."""
        return len(Patches(self.plan.facts.case.sky.subdivision))


def count(plan: Plan) -> Counted:
    """Count the work of a plan.

    A mesh of suns counts with a typical number of suns. Rounds toward a target are not counted.
    """
    counted = Counted(plan, Work(), {})
    suns: Suns | None = plan.facts.light.suns
    for state in ("open", "shaded"):
        if state == "shaded":
            suns = _suns_behind_shade(plan, counted.pilots["open"])
        if suns is None:
            continue
        pilot = counted.pilots[state] = Pilot.of(plan, state, _followed(plan, suns))
        behind = "shaded_state" if state == "shaded" else None
        amounts = [*_transport(pilot)]
        if isinstance(plan.facts.case.sun, Adaptive):
            amounts += _adaptive(plan, pilot, state, suns.where(plan.scope.enabled_suns(suns)))
        counted.work.add(amounts, 1, behind)
        counted.work.add(amounts, counted.channels - 1, behind or "colour")
    counted.work.add(_around(counted))
    return counted


def _suns_behind_shade(plan: Plan, pilot: Pilot) -> Suns | None:
    """Suns of the time stamps at which the pilot's sensors close the shade; None without any."""
    facts, shading = plan.facts, plan.simulated.shading
    if shading is None:
        return None
    normal = facts.light.sky["direct_normal_illuminance"].values
    closes = (normal > 0) | plan.scope.every_shade
    if not plan.scope.every_shade:
        E = normal[closes] * pilot.sunlit(facts.light.sun["direction"].values[closes])
        closes[closes] = (shading.threshold <= E).mean(axis=0) >= shading.area
    if not closes.any():
        return None
    return facts.light.suns.only(sources(facts.light.sky.isel(time=closes)))


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
    levels = plan.simulated.sun.finest - mesh.COARSEST if state == "open" else 0  # type: ignore[union-attr]
    yield "suns", "path", levels * pilot.count * pilot.paths.rays
    yield "suns", "shadow", pilot.straight(suns)
    yield "suns", "entry", len(pilot.points) * len(suns.labels)


def _transport(pilot: Pilot) -> Iterator[Amount]:
    """Work of one call of `coefficients.compute`."""
    yield "rest", "state", 1
    if not any(pilot.bins):
        return
    yield from pilot.traced()
    a, n, cells, bins = pilot.accuracy, len(pilot.points), pilot.cells, sum(pilot.bins)
    lit = 1.0 if pilot.scatters else LIT
    yield "interreflection", "product", a.replicates * n * cells * bins * lit
    yield "interreflection", "deposit", a.replicates * cells * bins
    yield "rest", "entry", a.replicates * n * bins
    yield "rest", "launch", a.replicates * -(-n // pilot.block)
    products = pilot.faces * (n + cells + REFLECTIONS * pilot.faces) * bins
    yield "scattering_panes", "product", a.replicates * products
    if pilot.films is not None:
        (patches, _), (sky_rows, _, values) = pilot.bins, pilot.film_rows
        yield "films", "film_sun", a.replicates * values * len(pilot.films.suns)
        yield "films", "film_sky", a.replicates * sky_rows * a.film_sky_samples * (patches > 0)


def _around(counted: Counted) -> Iterator[Amount]:
    """Work outside of transport: sky, accumulation, metrics, pictures, files."""
    hours, replicates = counted.plan.facts.hours, counted.plan.facts.case.accuracy.replicates
    patches = [pilot.bins[0] for pilot in counted.pilots.values()]
    yield "rest", "evaluation", 1
    yield "rest", "luminance", hours * max(1, patches[0])
    yield "rest", "accumulated", METRICS * counted.entries * replicates * sum(patches)
    yield "rest", "illuminance", counted.entries * replicates
    if counted.plan.scope.pictures:
        yield "pictures", "picture", 1
