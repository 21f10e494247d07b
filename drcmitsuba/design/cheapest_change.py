"""The least change of a façade that reaches the next level of a standard, from one simulation.

case ─ Layout ──────────► light by tile and material, all replicates
     ─ present ─────────► composition as it is
     ─ least_change ────► composition of the least changed area that reaches the level
     ─ standards.verdict ► both compositions judged by the same light paths: interval, probability
     ─ Layout.afresh ────► the change as drawn, by other light paths; more is asked where it fails
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.design.change import Change, Move
from drcmitsuba.design.change_problem import ChangeCandidate, ChangeProblem
from drcmitsuba.design.change_search import ChangeOptimum, least_change
from drcmitsuba.design.composed_facades import Facades
from drcmitsuba.design.facade_tiles import FacadeParts
from drcmitsuba.design.requirement import Requirement
from drcmitsuba.design.search import Optimum
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.standards import Evidence, Refusal, Verdict, read, verdict
from drcmitsuba.standards.terms import dated

MOST_JUDGED = 8
"""Largest number of façades that the search holds for passing and that are judged with draws."""
MOST_DRAWN = 3
"""Largest number of changes that are drawn, each asked for more than the one before."""
LEAST_MOVE = 0.01
"""Smallest part of the changed area that is named."""


def cheapest_changes(
    case: Case, judged: Sequence[Verdict], stage: Stage = silent
) -> list[Change | Refusal]:
    """Find the least change for the next level of each of several verdicts on one case.

    Its period is that of each standard. Where none can be told, a refusal says why: of all
    standards if a search cannot hold the case.
    """
    found: list[Change | Refusal] = []
    facades = dict[PeriodTable, Facades]()
    for each in judged:
        try:
            level_above(each)
            own = dated(case, read(each.standard))
            if own.period not in facades:
                facades[own.period] = Facades.of(own, stage)
            found.append(cheapest_change(each, facades[own.period], stage))
        except InputError as error:
            found.append(Refusal(each.standard, each.title, error))
    return found


def level_above(judged: Verdict) -> int:
    """Index of the level above the one that a verdict states; raises InputError for none."""
    if judged.undecided is not None:
        got = f"no level can be stated: {judged.undecided}"
        raise InputError(judged.standard, "levels", got, "ask for a change by another standard")
    if read(judged.standard).hours == "equinox":
        got = "moments of clear days, which no search holds"
        raise InputError(judged.standard, "hours", got, "ask for a change by another standard")
    target = 1 + max((i for i, level in enumerate(judged.levels) if level.reached), default=-1)
    if target == len(judged.levels):
        got = "the highest level is reached"
        raise InputError(judged.standard, "levels", got, "nothing has to change")
    return target


def cheapest_change(judged: Verdict, facades: Facades, stage: Stage = silent) -> Change:
    """Find the least change of a façade that reaches the level above the one of a verdict.

    Parameters
    ----------
    judged : Verdict
        Verdict on the façade as it is.
    facades : Facades
        Façades of the same case.
    stage : callable, optional

    Returns
    -------
    Change

    Raises
    ------
    InputError
        No level is left or can be stated, or the parameters cannot give the façade as it is.
    """
    layout, name, target = facades.layout, judged.standard, level_above(judged)
    now = verdict(name, facades.evidence(facades.present))
    level, groups = read(name).levels[target].name, facades.tiled.groups
    requirement = Requirement.of(layout.case, name, level, facades.light, groups)
    glass = facades.parts.glass if facades.problem.factors else {}
    problem = ChangeProblem(facades.problem, requirement, facades.present, glass)
    if now.levels[target].reached:
        return _change(_Tried(problem, problem.evaluate(problem.start), now), facades, now, target)
    best: _Tried | None = None
    for _ in range(MOST_DRAWN):
        with stage("search") as done:
            optimum = least_change(problem, layout.search, done, layout.known(facades.problem))
        tried = _judged(optimum, facades, name, target, stage)
        if best is None or tried.merit(target) > best.merit(target):
            best = tried
        if tried.drawn is None or tried.drawn.levels[target].reached:
            break
        raised = problem.requirement.raised(tried.drawn.levels[target].margin)
        if raised is None:
            break
        problem = replace(problem, requirement=raised)
    assert best is not None
    return _change(best, facades, now, target)


@dataclass(frozen=True)
class _Tried:
    """A change, and what it brings."""

    problem: ChangeProblem
    candidate: ChangeCandidate
    changed: Verdict
    """Verdict by the light paths of the search."""
    drawn: Verdict | None = None
    """Verdict by the light of other paths, drawn; None where the search does not reach the level,
    or was stopped."""
    evaluations: int = 1
    finished: bool = True

    def merit(self, target: int) -> tuple[bool, float]:
        """Sort key: whether the level is reached as drawn, and how far that is from its limit."""
        if self.drawn is None:
            return False, -np.inf
        return self.drawn.levels[target].reached, self.drawn.levels[target].margin.slack


def _judged(
    optimum: ChangeOptimum, facades: Facades, standard: str, target: int, stage: Stage
) -> _Tried:
    """Judge, with draws, the least change that reaches a level; else the nearest façade.

    The search counts in single precision: a point at its threshold may count otherwise here.
    """
    history, facade = optimum.history, optimum.problem.facade

    def judged(candidate: ChangeCandidate) -> Verdict:
        scale = facade.scale(facade.named(candidate.x))
        factors = {name: float(factor[0]) for name, factor in scale.items()}
        return verdict(standard, facades.evidence(candidate.share, factors))

    counts = optimum.evaluations, optimum.finished
    passing = [c for c in history.candidates if optimum.problem.holds(c)]
    for candidate in islice(sorted(passing, key=lambda c: c.cost), MOST_JUDGED):
        changed = judged(candidate)
        if changed.levels[target].reached:
            drawn = None
            if optimum.finished:
                design = Optimum[Any, Any](facade, candidate, history, True)
                evidence = Evidence.of_result(facades.layout.afresh(design, stage))
                drawn = verdict(standard, evidence)
            return _Tried(optimum.problem, candidate, changed, drawn, *counts)
    return _Tried(optimum.problem, optimum.best, judged(optimum.best), None, *counts)


def _change(tried: _Tried, facades: Facades, now: Verdict, target: int) -> Change:
    """Put a change together."""
    problem, candidate = tried.problem, tried.candidate
    before = problem.facade.given(problem.start_towards(candidate.x))
    after = problem.named(candidate.x)
    single = [p for p in problem.facade.free if p.count == 1]
    pairs = {p.key: (float(before[p.key][0]), float(after[p.key][0])) for p in single}
    return Change(
        standard=now.standard,
        level=now.levels[target].name,
        now=now,
        changed=tried.changed,
        drawn=tried.drawn,
        reaches=tried.changed.levels[target].reached,
        tried=tried.evaluations,
        finished=tried.finished,
        area=candidate.changed,
        moves=moves(problem, candidate, facades.parts),
        facade_area=facades.parts.area,
        parameters=pairs,
        composition=problem.details(candidate)["composition"],
        asked=problem.requirement.asked,
        tables=facades.layout.tables(candidate.share) if candidate.changed > 0 else {},
        notes=facades.layout.notes,
    )


def moves(
    problem: ChangeProblem, candidate: ChangeCandidate, parts: FacadeParts
) -> tuple[Move, ...]:
    """Areas that change from one material to another, or keep it with another transmittance.

    In a tile that loses and gains several materials, each loss is shared out by the gains.
    """
    tiles, share = problem.facade.year.tiles, candidate.share
    lost, gained = (np.maximum(s * (share - problem.now), 0) for s in (-1, 1))
    part = gained / np.maximum(gained.sum(axis=1, keepdims=True), 1e-12)
    areas = tiles.area[:, None, None] * lost[:, :, None] * part[:, None, :]
    least = LEAST_MOVE * candidate.changed
    of_names = defaultdict[tuple[str, str], list[tuple[int, float]]](list)
    for tile, i, j in zip(*np.nonzero(areas), strict=True):
        names = parts.fills[tile][i], parts.fills[tile][j]
        of_names[names].append((int(tile), float(areas[tile, i, j])))
    out = list(_transmittances(problem, candidate))
    for (before, after), own in of_names.items():
        area = sum(a for _, a in own)
        if area > least:
            where = np.array([tile for tile, a in own if a > least / len(tiles)])
            low, high = (tiles.bounds[where, k] for k in (2, 3))
            heights = (float(low.min()), float(high.max())) if parts.upright[where].all() else None
            places = dict.fromkeys(filter(None, (parts.places[tile] for tile in where)))
            out.append(Move(before, after, area, heights, tuple(places)))
    return tuple(sorted(out, key=lambda move: -move.area))


def _transmittances(problem: ChangeProblem, candidate: ChangeCandidate) -> Iterator[Move]:
    """Yield panes that stay, with another transmittance."""
    values = problem.named(candidate.x)
    for key, area in problem.replaced(candidate).items():
        now, then = (float(v[key][0]) for v in (problem.values_now, values))
        if area > 0:
            yield Move(f"glazing of transmittance {now:.3f}", f"{then:.3f}", area)
