"""The work of an evaluation, counted by effect and by unit before it is done."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast.closing import closing
from drcmitsuba.plan.forecast.photons import flown, pilots, ports_of
from drcmitsuba.plan.forecast.survey import Survey
from drcmitsuba.runtime.ray_counter import KINDS
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.surfaces import State
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import sources
from drcmitsuba.sky.sun_models import Suns, mesh
from drcmitsuba.transport.coefficients import EDGE_SAMPLES
from drcmitsuba.transport.shadow_rays import RIM
from drcmitsuba.transport.sun_interpolation import HELD_OUT

MESH_SUNS = 500
"""Suns that an adaptive mesh ends with, more or less."""
EDGES = 0.03
"""Part of the pairs of sensor and sun whose rays cross the edge of a shadow."""
SETTLING = 4
"""Reflections from pane to pane."""
UNHIDDEN = 0.9
"""Part of the rays to films that nothing stands in the way of."""
METRICS = 2
"""How often illuminances are accumulated: for E, and for their draws."""


@dataclass
class Work:
    """Amounts of work by effect and unit; units that are kinds of rays count rays.

    Parameters
    ----------
    amounts : dict of (str, str) to float
        By effect and unit.
    """

    amounts: dict[tuple[str, str], float] = field(default_factory=lambda: defaultdict(float))

    def add(self, effect: str, unit: str, amount: float) -> None:
        """Take some work."""
        if amount:
            self.amounts[effect, unit] += amount

    def take(self, other: Work, times: float = 1.0, effect: str | None = None) -> None:
        """Take all of another one's, under the name of one effect if it is given."""
        for (name, unit), amount in other.amounts.items():
            self.add(effect or name, unit, times * amount)

    @property
    def by_unit(self) -> dict[str, float]:
        """Amounts of every unit."""
        out: dict[str, float] = defaultdict(float)
        for (_, unit), amount in self.amounts.items():
            out[unit] += amount
        return dict(out)

    @property
    def rays(self) -> dict[str, int]:
        """Rays by kind, as `tally.RayCounter` counts them."""
        units = self.by_unit
        return {kind: round(units.get(kind, 0)) for kind in KINDS}


@dataclass(frozen=True)
class Counted:
    """All that is counted of a plan.

    Parameters
    ----------
    plan : Plan
    work : Work
    surveys : dict of State to Survey
        Of the states that are simulated.
    bins : dict of State to (int, int)
        Sky bins, and suns with a coefficient that is not 0.
    """

    plan: Plan
    work: Work
    surveys: dict[State, Survey]
    bins: dict[State, tuple[int, int]]

    @property
    def channels(self) -> int:
        """Colour channels that are simulated."""
        return len(LUMINANCE_WEIGHTS) if self.plan.scope.channels else 1

    @property
    def stamps(self) -> int:
        """Time stamps."""
        return self.plan.facts.hours

    @property
    def sensors(self) -> int:
        """Number of them."""
        count = self.plan.facts.case.sensors.count
        return count[0] * count[1]


def count(plan: Plan) -> Counted:
    """Count the work that a plan asks for.

    Parameters
    ----------
    plan : Plan

    Notes
    -----
    What depends on what is found is left at its mean: how far a mesh of suns is refined, how many
    points are too close to call. Rounds toward a target are not counted.
    """
    work, case = Work(), plan.simulated
    surveys: dict[State, Survey] = {}
    bins: dict[State, tuple[int, int]] = {}
    channels = len(LUMINANCE_WEIGHTS) if plan.scope.channels else 1
    for state, own in _states(plan):
        suns = _followed(plan, own)
        survey = Survey(case, state, plan.scope, suns)
        surveys[state] = survey
        one = Work()
        if survey.patches or suns.labels:
            adaptive = isinstance(case.sun, Adaptive)
            one = _adaptive(survey, own) if adaptive else _compute(survey)
        one.add("rest", "state", 1)
        behind = "shaded_state" if state == "shaded" else None
        work.take(one, 1, behind)
        work.take(one, channels - 1, behind or "colour")
        bins[state] = survey.patches, len(suns.labels)
    counted = Counted(plan, work, surveys, bins)
    for effect, unit, amount in _around(counted):
        work.add(effect, unit, amount)
    return counted


def _states(plan: Plan) -> Iterator[tuple[State, Suns]]:
    """States that are simulated, and the suns of the time stamps that each is needed for."""
    light, case = plan.facts.light, plan.simulated
    yield "open", light.suns
    if case.shading is not None:
        closes = closing(plan.facts, plan.scope)
        if closes.any():
            yield "shaded", light.suns.only(sources(light.sky.isel(time=closes)))


def _followed(plan: Plan, suns: Suns) -> Suns:
    """Suns that are followed for others; those of a mesh where the sun is adaptive."""
    if isinstance(plan.facts.case.sun, Adaptive):
        suns = mesh_suns(plan.facts.light.sky.attrs["latitude"], suns.diameter)
    return suns.where(plan.scope.enabled_suns(suns))


def mesh_suns(latitude: float, diameter: float) -> Suns:
    """Suns in place of an adaptive mesh: `MESH_SUNS` possible ones, without straight light."""
    possible = mesh.possible_suns(latitude)
    at = np.linspace(0, len(possible) - 1, MESH_SUNS + HELD_OUT).round().astype(int)
    labels = tuple(f"{mesh.PREFIX}{i}" for i in range(len(at)))
    return Suns(labels, possible[at], diameter, straight=False)


def _adaptive(survey: Survey, own: Suns) -> Work:
    """Mesh of suns, gathered anew for each level; the time stamps' suns straight."""
    levels = survey.case.sun.finest - mesh.COARSEST if survey.state == "open" else 0  # type: ignore[union-attr]
    work = _compute(survey)
    again = Work()
    _gather(survey, again)
    work.take(again, levels, "suns")
    own = own.where(survey.scope.enabled_suns(own))
    straight = Survey(survey.case, survey.state, survey.scope, own)
    seen = straight.seen("sensors")
    pairs = seen.count * len(own.labels)
    shares = RIM + EDGES * EDGE_SAMPLES * survey.accuracy.replicates
    work.add("suns", "shadow", seen.suns * pairs * shares)
    work.add("suns", "sun_lane", seen.tried * seen.count * RIM)
    work.add("suns", "entry", pairs * RIM)
    return work


def _compute(survey: Survey) -> Work:
    """One call of `coefficients.compute`."""
    work, a = Work(), survey.accuracy
    _gather(survey, work)
    cells, sensors = survey.seen("cells"), survey.seen("sensors")
    suns, patches, replicates = len(survey.suns.labels), survey.patches, survey.accuracy.replicates
    samples = a.sensor_sun_samples if survey.suns.straight else 0
    _straight(survey, work, "cells", a.cell_sky_rays, 1)
    _straight(survey, work, "sensors", a.sensor_sky_rays, samples)
    lit_sky, lit_sun = cells.lit_by_sky, cells.lit_by_suns
    if survey.pane_patches is not None or survey.films is not None or survey.scene.followed:
        lit_sky = lit_sun = 1.0
    n, k = sensors.count, cells.count
    work.add("interreflection", "product", replicates * n * k * lit_sky * patches * _opened(survey))
    work.add("interreflection", "product", replicates * n * k * lit_sun * suns)
    work.add("rest", "entry", replicates * n * (patches + suns))
    work.add("interreflection", "deposit", replicates * k * (patches + suns))
    work.add("rest", "launch", replicates * survey.blocks)
    if survey.pane_patches is not None:
        _panes(survey, work)
    if survey.films is not None:
        _films(survey, work)
    _photons(survey, work)
    return work


def _opened(survey: Survey) -> float:
    """Share of the sky's bins that reach any cell."""
    scattering = survey.pane_patches is not None or survey.films is not None
    return 1.0 if scattering or survey.scene.followed else survey.seen("cells").patches


def _gather(survey: Survey, work: Work) -> None:
    """Paths of all replicates."""
    a = survey.accuracy
    paths = a.replicates * a.paths * len(survey.sensors[0]) + survey.pilots
    if survey.scope.depth != 0:
        work.add("interreflection", "path", paths * survey.walked.flights)
        work.add("interreflection", "vertex", paths * survey.walked.vertices)


def _straight(survey: Survey, work: Work, kind: str, rays: int, samples: int) -> None:
    """Shadow rays of receivers, `rays` to the sky and `samples` to every sun."""
    seen, replicates = survey.seen(kind), survey.accuracy.replicates
    many = replicates * seen.count
    effect = {"faces": "scattering_panes", "film faces": "films"}.get(kind)
    if survey.subdivision and rays:
        work.add(effect or "sky", "shadow", many * rays * seen.sky)
        work.add(effect or "ground", "shadow", many * rays * seen.ground)
        if seen.sky + seen.ground:
            part = seen.ground / (seen.sky + seen.ground)
            work.add(effect or "sky", "sky_lane", many * rays * (1 - part))
            work.add(effect or "ground", "sky_lane", many * rays * part)
    suns = many * samples * len(survey.suns.labels) * seen.suns
    work.add(effect or "suns", "shadow", suns)
    if any(lets_through(part.material) for part in survey.scene.parts):
        work.add(effect or "sky", "pierced", many * rays * (seen.sky + seen.ground) * seen.free)
        work.add(effect or "suns", "pierced", suns * seen.free)
    work.add(effect or "suns", "sun_lane", many * samples * seen.tried)


def _panes(survey: Survey, work: Work) -> None:
    """Panes that scatter evenly: their faces, and looks at them."""
    a, patches = survey.accuracy, survey.pane_patches
    assert patches is not None
    _straight(survey, work, "faces", 4 * a.cell_sky_rays, 1)
    faces, bins = 2 * len(patches), survey.patches + len(survey.suns.labels)
    for kind in ("cells", "sensors", "faces"):
        count = survey.seen(kind).count
        many = a.replicates * count
        work.add("scattering_panes", "pane", many * a.pane_points * survey.looks(patches, kind))
        work.add("scattering_panes", "look", 2 * many * a.pane_points)
        times = SETTLING if kind == "faces" else 1
        work.add("scattering_panes", "product", times * many * faces * bins)


def _films(survey: Survey, work: Work) -> None:
    """Films: their answers, what reaches them, and looks at them."""
    a, films = survey.accuracy, survey.films
    assert films is not None
    _straight(survey, work, "film faces", 0, 1)
    tables = survey.film_tables
    lit = len(films.suns)
    work.add("films", "film_sun", a.replicates * tables.evaluated * lit)
    if survey.subdivision:
        work.add("films", "film_sky", a.replicates * tables.sky_rows * a.film_sky_samples)
        work.add("films", "shadow", a.replicates * tables.looking * a.film_sky_samples / 2)
    receivers = ["cells", "sensors"] + (["faces"] if survey.pane_patches is not None else [])
    for kind in receivers:
        many = a.replicates * survey.seen(kind).count * a.pane_points
        looks = many * survey.looks(films.patches, kind)
        work.add("films", "pane", looks)
        work.add("films", "look", 2 * many)
        work.add("films", "film_sum", looks * UNHIDDEN * (lit + survey.patches))


def _photons(survey: Survey, work: Work) -> None:
    """Photons of all ports."""
    replicates, every = survey.accuracy.replicates, ports_of(survey)
    work.add("components", "shadow", pilots(every))
    for ports, kind in itertools.product(every, ("sky", "sun")):
        found = flown(survey, ports, kind)
        effect = "components" if found.name else "pane_to_pane"
        work.add(effect, "photon", replicates * found.followed * found.flights)
        work.add(effect, "start", replicates * found.tried)
        work.add(effect, "shadow", replicates * found.tests)


def _around(counted: Counted) -> Iterator[tuple[str, str, float]]:
    """All but transport: sky, accumulation, metrics, pictures, writing."""
    facts, scope = counted.plan.facts, counted.plan.scope
    replicates = facts.case.accuracy.replicates
    entries = counted.stamps * counted.sensors * counted.channels
    yield "rest", "evaluation", 1
    yield "rest", "luminance", counted.stamps * max(1, counted.surveys["open"].patches)
    patches = sum(sky for sky, _ in counted.bins.values())
    yield "rest", "accumulated", METRICS * entries * replicates * patches
    yield "rest", "illuminance", entries * replicates
    if scope.pictures:
        yield "pictures", "picture", 1
