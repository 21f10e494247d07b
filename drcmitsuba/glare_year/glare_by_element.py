"""Glare of a case by opening and fill, from which that of any façade is summed without a ray.

case, eyes, fills ─ openings_of ─► openings with their fills
     ─ ElementTracing ───────────► E_v by element; what is seen from each place by element
choice ─ FacadesOfCase ──────────► shares of fills by the hour
     ─ samples_of, rated ────────► GlareYear
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from numpy.typing import ArrayLike

from drcmitsuba.annual.choice import Choice
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import Opened
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.eye.openings import note_of
from drcmitsuba.glare_year.by_element import ElementTracing, EyeIlluminance
from drcmitsuba.glare_year.element_sampler import samples_of
from drcmitsuba.glare_year.eyes import Eyes, eyes
from drcmitsuba.glare_year.facades import FacadesOfCase
from drcmitsuba.glare_year.place import SeenPlace
from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.year import rated
from drcmitsuba.plan import without_rounds
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.scene.fills import Fills
from drcmitsuba.sky.daylight import daylight


@dataclass(frozen=True, repr=False)
class GlareElements:
    """Views of eyes, and the light at them, by element, an opening with one fill.

    Examples
    --------
    >>> import drcmitsuba
    >>> seen = drcmitsuba.glare_elements("desk.toml")
    >>> seen.evaluate({"south": "shade"}).share(0.40).dims
    ('state', 'view')
    """

    facades: FacadesOfCase
    looking: Eyes
    rule: Rule
    illuminance: EyeIlluminance
    places: tuple[SeenPlace, ...]
    notes: tuple[str, ...]
    """Notes on the case, and on what is left out."""

    @property
    def case(self) -> Case:
        """Case whose eyes these are."""
        return self.facades.case

    @property
    def openings(self) -> tuple[str, ...]:
        """Names of the openings."""
        return tuple(self.fills)

    @property
    def fills(self) -> dict[str, tuple[str, ...]]:
        """Names of the fills by opening; the first one is what the case draws there."""
        return self.facades.fills

    def evaluate(self, choice: Choice | None = None) -> GlareYear:
        """Evaluate the glare of a façade, without tracing anything.

        Parameters
        ----------
        choice : mapping, optional
            Fill by opening, as for `annual.elements.Elements.evaluate`: the name of a fill, shares
            of fills by name that add up to 1, or either by the hour. Openings that it does not name
            stay as in the case: groups close by the rule of the shade or by their schedules.

        Returns
        -------
        GlareYear
            As from `drcmitsuba.glare`: all groups that still move open, in their next state, and so
            on, and `applied`, in which each hour has the state that they take. With a choice by
            the hour, `applied` alone.

        Raises
        ------
        InputError
            An opening or a fill is unknown, shares do not add up to 1, or an hour is missing.

        Notes
        -----
        Where several fills share an opening, its glare sources are those seen by each fill alone,
        which count with its share: so many parts of the opening, mixed finely.
        """
        run = replace(self.facades.run, seconds=dict(self.facades.run.seconds))
        with one_blas_thread():
            facades = replace(self.facades, run=run).of(choice or {})
            with run.timed("sums"):
                samples = samples_of(
                    facades.every, self.illuminance, self.places, self.looking, self.rule
                )
            light = self.facades.light
            return rated(
                self.case, light, self.looking, tuple(facades.shares), samples, self.notes,
                rule=self.rule, run=run, drawn=facades.drawn,
            )  # fmt: skip

    def __repr__(self) -> str:
        some = ", ".join(f"{name}: {' | '.join(fills)}" for name, fills in self.fills.items())
        return f"<GlareElements of {self.case.name!r}: {len(self.looking)} views; {some}>"


def glare_elements(
    case: Case | str | Path, points: ArrayLike | None = None, *, fills: Fills = (),
    rule: Rule | None = None, stage: Stage = silent,
) -> GlareElements:  # fmt: skip
    """Simulate what the eyes of a case see, and the light at them, by opening and fill.

    Parameters
    ----------
    case, points, rule, stage
        As for `drcmitsuba.glare`; true suns take the place of an adaptive one.
    fills : sequence of str, or mapping of str to sequence of str, optional
        Further fills of all openings, or of some by their names, as for `drcmitsuba.elements`. By
        default what the case itself may put there.

    Returns
    -------
    GlareElements

    Raises
    ------
    InputError
        As for `drcmitsuba.glare`; an opening or a fill is unknown, a group has states with surfaces
        of their own, or memory does not hold so many elements.

    Examples
    --------
    >>> import drcmitsuba
    >>> drcmitsuba.glare_elements("desk.toml", fills=["hole"]).fills
    {'south': ('glass', 'shade', 'hole')}
    """
    case = (case if isinstance(case, Case) else load_case(case)).with_true_suns()
    backend.select()
    run, rule = replace(Run.of(case), stage=stage), Rule() if rule is None else rule
    looking = eyes(case, points)
    with one_blas_thread():
        with run.timed("sky"):
            light = daylight(case)
            panes, planned, run = Opened.of(case, fills, light, run, looking.positions)
        tracing = ElementTracing(case, panes, light, run)
        illuminance = tracing.at_eyes(looking)
        with run.timed("what is seen") as done:
            places = []
            for place in tracing.places(looking, rule.least):
                places.append(place)
                done(sum(len(each.views) for each in places) / len(looking))
        again = note_of(max(place.seen.again for place in places))
    aimed = without_rounds(case.accuracy.goal)
    notes = (*light.notes, *planned.summed(always=True).notes(), *again, *aimed)
    facades = FacadesOfCase(case, panes, light, run)
    return GlareElements(facades, looking, rule, illuminance, tuple(places), notes)
