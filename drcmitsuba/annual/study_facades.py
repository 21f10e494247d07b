"""Rows of a study that differ in their façades: metrics of all of them from one simulation.

rows   ─ together ────► lists of rows that may share light: one room, sky, shade, place of windows
list   ─ jobs ────────► parts whose elements fit in memory
part   ─ alike ───────► their cases, with one name for each material
       ─ SharedElements ─► metrics of each row, by its own thresholds
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import Any

from drcmitsuba.annual.variants import SharedElements, shared_facades
from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.groups import Group
from drcmitsuba.case.shading import AREA, THRESHOLD
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.model.materials import Material
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.toml import fits
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import elements as by_element

LEAST = 6
"""Least number of different façades that are simulated together; fewer cost less one by one."""
MEMORY = 3 << 30
"""Largest memory of light by element [bytes]; more rows are cut into parts."""
OWN = ("name", "facade", "materials", "shading", "design", "views", "metrics")
"""Tables in which rows that share light may differ."""


def together(rows: Iterable[tuple[int, Case, str]]) -> list[list[int]]:
    """Rows that are worth simulating together, as lists of those that may share light.

    Parameters
    ----------
    rows : iterable of tuple
        Number, case and digest of the daylight of each row.
    """
    sharing: dict[str, dict[int, str]] = {}
    for number, case, weather in rows:
        if _may_share(case):
            common = content_key(weather, *_common(case))
            sharing.setdefault(common, {})[number] = _facade(case)
    return [[*each] for each in sharing.values() if len({*each.values()}) >= LEAST]


def _may_share(case: Case) -> bool:
    """Whether elements can hold the façade of a case."""
    has_target = case.accuracy.sensor_goal is not None or isinstance(case.sun, Adaptive)
    has_facade = case.room is not None or case.model is not None
    return has_facade and not (case.components or has_target)


def _common(case: Case) -> tuple[object, ...]:
    """Content that cases that share light have in common."""
    frames = {side: facade.frame_reflectance for side, facade in case.facade.items()}
    shade: tuple[object, ...] = ()
    if case.shading is not None:
        rule = case.shading.model_copy(update={"threshold": THRESHOLD, "area": AREA})
        shade = rule, case.materials[case.shading.material]
    return case.model_dump(mode="json", exclude=set(OWN)), sorted(case.glazed), frames, shade


def _facade(case: Case) -> str:
    return content_key(case.facade, case.materials)


def alike(cases: Sequence[Case]) -> list[Case]:
    """Cases that share light, with the tables of the first and one material for each name.

    A material that another row has under the same name takes a name of its own; panes of a model
    keep the names that they have there.
    """
    first, known = cases[0], dict[str, Material]()
    common = {table: getattr(first, table) for table in OWN if table not in ("facade", "materials")}
    of_model = {name for layer in first.building.layers for name in layer.names}
    made = []
    for case in cases:
        names = {
            name: name if name in of_model else _free(name, material, known)
            for name, material in case.materials.items()
        }
        materials = {names[name]: material for name, material in case.materials.items()}
        known |= {name: m for name, m in materials.items() if name not in of_model}
        facade = {side: _renamed(table, names) for side, table in case.facade.items()}
        groups = {name: _regrouped(group, names) for name, group in case.groups.items()}
        made.append(case.with_tables(**common, facade=facade, groups=groups, materials=materials))
    return made


def _free(name: str, material: Material, known: Mapping[str, Material]) -> str:
    """First of the names "film", "film 2", "film 3" … under which no other material is known."""
    names = chain([name], (f"{name} {number}" for number in count(2)))
    return next(each for each in names if known.get(each, material) == material)


def _regrouped(group: Group, names: Mapping[str, str]) -> Group:
    """Group whose panes and states have other names of materials."""
    new = (n for n in names if fits(n, group.panes))
    panes = dict.fromkeys((*group.panes, *(names[name] for name in new))) if group.panes else ()
    states = (names[name] for name in group.states)
    return group.model_copy(update={"panes": tuple(panes), "states": tuple(states)})


def _renamed(facade: Facade, names: Mapping[str, str]) -> Facade:
    """Façade with other names of the materials; `wall` and `open` stay."""
    strips = (
        strip.model_copy(update={"material": names.get(strip.material, strip.material)})
        for strip in facade.strips
    )
    return facade.model_copy(update={"strips": tuple(strips)})


@dataclass(frozen=True)
class FacadesJob:
    """Evaluation of rows that share light, here or by a worker."""

    cases: Sequence[Case]
    """All cases that share light, whoever evaluates them: the numbers depend on all."""
    wanted: Sequence[int]
    """Numbers of the cases to evaluate."""

    def each(self, light: Daylight, progress: Progress) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield the number and the metrics of each wanted case."""

        @contextmanager
        def stage(name: str) -> Iterator[Progress]:
            yield part(progress, 0.0, 0.5 * (name == "elements"))

        shared = SharedElements.of(alike(self.cases), stage, light, self.cases)
        for done, number in enumerate(self.wanted, 1):
            yield number, shared.evaluate(number).metrics
            progress(0.5 + 0.5 * done / len(self.wanted))

    def make(self, progress: Progress) -> dict[int, dict[str, Any]]:
        """Metrics of the wanted cases, by number."""
        return dict(self.each(daylight(self.cases[0]), progress))

    def without(self, numbers: Collection[int]) -> FacadesJob:
        """Job that leaves out some of the wanted cases."""
        return replace(self, wanted=[number for number in self.wanted if number not in numbers])

    def split(self, count: int) -> list[FacadesJob]:
        """Jobs that evaluate about equally many of the wanted cases each, at most `count`."""
        shares = (self.wanted[first::count] for first in range(count))
        return [replace(self, wanted=share) for share in shares if share]


def jobs(cases: Sequence[Case], suns: Suns) -> list[FacadesJob]:
    """Jobs whose elements fit in memory: all cases are one job, or each half is jobs.

    Cases are left out where a job becomes too small, or no elements can hold them.
    """
    if len({_facade(case) for case in cases}) < LEAST:
        return []
    if _fits(alike(cases), suns):
        return [FacadesJob(cases, range(len(cases)))]
    half = len(cases) // 2
    return [*jobs(cases[:half], suns), *jobs(cases[half:], suns)]


def _fits(cases: Sequence[Case], suns: Suns) -> bool:
    first = cases[0]
    try:
        facades = shared_facades(cases)
    except InputError:  # of a row, which tells so when it is evaluated by itself
        return False
    if facades.bringing:  # how many sets of surfaces stand, each row tells
        return False
    sensors, subdivision = len(prepared(first).receivers), first.sky.subdivision
    size = by_element.memory(facades.panes.states, suns, first.accuracy, sensors, subdivision)
    return size < MEMORY
