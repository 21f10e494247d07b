"""Plan: which effects a case calls for, why, and what the evaluation will cost.

panes
    Materials of the façades by their effect on light; largest albedo and depth.
facts, effect, decide, reflected, mirrors
    One function for each effect, with the quantity that decides it.
summed_year, notes
    What is left out where E of a year is a sum over groups of panes; notes for the user on the
    films and on the results.
planning
    `plan`: all decisions about a case, and the enabled effects that transport reads.

forecast
    Rays, seconds, memory and disk of an evaluation.
"""

from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.plan.notes import light_notes, notes, notes_on_sum, without_rounds
from drcmitsuba.plan.planning import Plan, plan

__all__ = [
    "Effect", "Facts", "Plan", "light_notes", "notes", "notes_on_sum", "plan", "without_rounds",
]  # fmt: skip
