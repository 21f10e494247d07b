"""The least change of a façade that reaches the next level of a standard, from one simulation.

case ─ Layout ──────────► light by tile and material, all replicates
     ─ present ─────────► composition as it is
     ─ least_change ────► composition of the least changed area that reaches the level
     ─ standards.verdict ► both compositions judged by the same light paths: interval, probability
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.design.change import Change, Move
from drcmitsuba.design.change_problem import ChangeCandidate, ChangeProblem
from drcmitsuba.design.change_search import ChangeOptimum, least_change
from drcmitsuba.design.composed_facades import Facades
from drcmitsuba.design.requirement import Requirement
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.standards import Refusal, Verdict, read, verdict
from drcmitsuba.standards.terms import dated

MOST_JUDGED = 8
"""Largest number of façades that the search holds for passing and that are judged with draws."""
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
    problem = ChangeProblem(facades.problem, requirement, facades.present)
    if now.levels[target].reached:
        start = problem.evaluate(problem.start)
        return _change(problem, facades, now, now, target, start, (1, True))
    with stage("search") as done:
        optimum = least_change(problem, layout.search, done, layout.known(facades.problem))
    candidate, changed = _judged(optimum, facades, judged.standard, target)
    counts = optimum.evaluations, optimum.finished
    return _change(problem, facades, now, changed, target, candidate, counts)


def _judged(
    optimum: ChangeOptimum, facades: Facades, standard: str, target: int
) -> tuple[ChangeCandidate, Verdict]:
    """Verdict, with draws, on the least change that reaches a level; else on the nearest façade.

    The search counts in single precision: a point at its threshold may count otherwise here.
    """
    history = optimum.history
    passing = [c for c in history.candidates if optimum.problem.holds(c)]
    for candidate in islice(sorted(passing, key=lambda c: c.changed), MOST_JUDGED):
        changed = verdict(standard, facades.evidence(candidate.share))
        if changed.levels[target].reached:
            return candidate, changed
    return optimum.best, verdict(standard, facades.evidence(optimum.best.share))


def _change(
    problem: ChangeProblem, facades: Facades, now: Verdict, changed: Verdict, target: int,
    candidate: ChangeCandidate, counts: tuple[int, bool],
) -> Change:  # fmt: skip
    """Put a change together; `counts` are the tried façades and whether the search ended."""
    layout, (tried, finished) = facades.layout, counts
    assert layout.case.room is not None
    before = problem.named(problem.start_towards(candidate.x))
    after = problem.named(candidate.x)
    single = [p for p in problem.facade.free if p.count == 1]
    pairs = {p.key: (float(before[p.key][0]), float(after[p.key][0])) for p in single}
    return Change(
        standard=now.standard,
        level=now.levels[target].name,
        now=now,
        changed=changed,
        reaches=changed.levels[target].reached,
        tried=tried,
        finished=finished,
        area=candidate.changed,
        moves=moves(problem, candidate.share),
        facade_area=layout.length * layout.case.room.size[2],
        parameters=pairs,
        composition=problem.details(candidate)["composition"],
    )


def moves(problem: ChangeProblem, share: np.ndarray) -> tuple[Move, ...]:
    """Areas that change from one material to another in a composition, shape (tile, material).

    In a tile that loses and gains several materials, each loss is shared out by the gains.
    """
    year = problem.facade.year
    lost, gained = (np.maximum(s * (share - problem.now), 0) for s in (-1, 1))
    part = gained / np.maximum(gained.sum(axis=1, keepdims=True), 1e-12)
    areas = year.tiles.area[:, None, None] * lost[:, :, None] * part[:, None, :]
    least, out = LEAST_MOVE * areas.sum(), []
    for i, j in zip(*np.nonzero(areas.sum(axis=0) > least), strict=True):
        where = np.flatnonzero(areas[:, i, j] > least / len(areas))
        low, high = (year.tiles.bounds[where, k] for k in (2, 3))
        area = float(areas[:, i, j].sum())
        out.append(
            Move(year.materials[i], year.materials[j], area, float(low.min()), float(high.max()))
        )
    return tuple(sorted(out, key=lambda move: -move.area))
