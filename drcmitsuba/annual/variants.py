"""Several façades of one room from one simulation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.choice import ChosenFills
from drcmitsuba.annual.chosen_facade import ChosenFacade, KnownLight
from drcmitsuba.annual.light_with_surfaces import light_with_surfaces, simulate_scheduled
from drcmitsuba.annual.recombined_year import recombined
from drcmitsuba.annual.result import Result
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.plan import Plan, notes, plan, without_rounds
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.shared_facades import SharedFacades
from drcmitsuba.sky.daylight import Daylight, daylight, daylight_and_year
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight

WITHOUT = (
    "coefficients of variants are not written, by which verdicts have hours beyond the period, and "
    'their probability: [output] illuminance = "all" writes them, or evaluate one by itself'
)
"""Note on a variant whose coefficients are made only when they are asked for."""


def load_variants(path: str, names: Sequence[str]) -> list[Case]:
    """Load a case, a TOML file or a shipped one, and its variants in the same folder.

    `names` are the names of the variants' files, without their ending.

    Raises
    ------
    InputError
        A case is unfit, or a name comes twice or holds a folder.
    """
    first = Path(path)
    every = [first.stem, *names]
    for name in names:
        if not name or Path(name).name != name or every.count(name) > 1:
            got = f"{name!r}"
            raise InputError("command line", "--variants", got, "name files beside the case, once")
    ending = first.suffix if first.is_file() else ""  # shipped cases have none
    return [load_case(path), *(load_case(str(first.with_name(name + ending))) for name in names)]


@dataclass(frozen=True)
class SharedElements:
    """Light by element of several cases, each of which gets its result from it."""

    light: Daylight
    facades: SharedFacades
    planned: Sequence[Plan]
    """Plan of each case, with the rules of the metrics by which it is evaluated."""
    scope: EnabledEffects
    """Effects that were simulated: those that any of the cases calls for."""
    channels: tuple[AnyLight, ...]
    remarks: list[list[str]]
    """Notes on the films and the shade of each case."""
    run: Run

    @classmethod
    def of(
        cls, cases: Sequence[Case], stage: Stage = silent, light: Daylight | None = None,
        judged: Sequence[Case] | None = None,
    ) -> SharedElements:  # fmt: skip
        """Simulate the light of cases that differ in their façades only, by tile and fill.

        Parameters
        ----------
        cases : sequence of Case
            Cases of a room of boxes, or of a model. True suns take the place of adaptive ones,
            and a target adds no rounds.
        stage : callable, optional
        light : Daylight, optional
            Daylight of the cases; by default computed, with the hours beyond the period where the
            coefficients of a case are written.
        judged : sequence of Case, optional
            The same façades with other rules of the metrics, by which each is evaluated.

        Raises
        ------
        InputError
            The cases cannot share a simulation: they differ in more than façades, have a structure
            in a strip, or need more memory than there is.
        """
        backend.select()
        cases = [case.with_true_suns() for case in cases]
        is_study = judged is not None
        judged = [case.with_true_suns() for case in judged or cases]
        first = cases[0]
        facades = shared_facades(cases)
        run = replace(Run.of(first), stage=stage)
        accuracy = run.accuracy(first)
        with run.timed("sky"):
            if light is None:  # hours beyond the period need C
                writes_C = any(case.output.illuminance == "all" for case in cases)
                light = daylight_and_year(first) if writes_C else daylight(first)
            remarks, planned = [], []
            for case in judged:  # models of a study are read anew
                # Notes read the films' files, which may be unfit.
                told = [] if is_study or case.output.illuminance == "all" else [WITHOUT]
                remarks.append([*notes(case), *without_rounds(case.accuracy.sensor_goal), *told])
                planned.append(plan(case, light))
            scope = joined_effects([each.scope for each in planned])
        with run.timed("elements") as done:
            channels = light_with_surfaces(
                facades.case, facades.panes, facades.bringing, light.suns, accuracy, scope, done
            )
        return cls(light, facades, planned, scope, channels, remarks, run)

    def evaluate(self, number: int) -> Result:
        """Evaluate one of the cases."""
        planned = self.planned[number]
        run = replace(
            self.run, enabled_effects=planned.scope, seconds=dict(self.run.seconds),
            ray_counter=Counter(self.run.ray_counter),
        )  # fmt: skip
        facade = ChosenFacade.of(
            planned.simulated, self.facades.panes, self.channels,
            attributes(planned.simulated, self.light, planned.scope), self.light.sky["time"],
            ChosenFills({}, {}), self.facades.drawn[number], self.facades.members[number],
            self._known, self.facades.factors[number] if self.facades.factors else 1.0,
        )  # fmt: skip
        simulate_scheduled(facade, self.light, run)
        return recombined(
            facade, planned, self.light, run, self.remarks[number], planned.facts.case.name
        )

    @cached_property
    def _known(self) -> KnownLight:
        """Luminances of the bins by which each case sums its light."""
        return KnownLight.by_bin(self.channels, self.light)


def evaluate_variants(cases: Sequence[Case], stage: Stage = silent) -> Iterator[Result]:
    """Evaluate several façades of one room from one simulation.

    Parameters
    ----------
    cases : sequence of Case
        Cases of a room of boxes, or of a model, that differ in their façades only.
    stage : callable, optional

    Yields
    ------
    Result
        Result of each case; its seconds include those of the shared simulation.

    Raises
    ------
    InputError
        As `SharedElements.of`.

    Notes
    -----
    Variants share their light paths: the difference of two has a smaller error than either one.
    """
    shared = SharedElements.of(cases, stage)
    for number in range(len(cases)):
        yield shared.evaluate(number)


def shared_facades(cases: Sequence[Case]) -> SharedFacades:
    """Openings that cases share, with multiples of panes; errors as `SharedFacades.of`."""
    shading = cases[0].shading
    return SharedFacades.of(cases).with_multiples(None if shading is None else shading.material)


def joined_effects(scopes: Sequence[EnabledEffects]) -> EnabledEffects:
    """Effects that any of several cases calls for."""

    def some(name: str) -> bool:
        return any(getattr(scope, name) for scope in scopes)

    return replace(
        scopes[0],
        sun_visibility=None,  # each opening tells which suns face it
        suns=some("suns"),
        clear_panes=some("clear_panes"),
        scattering_panes=some("scattering_panes"),
        films=some("films"),
        obstructions=some("obstructions"),
        pane_to_pane=some("pane_to_pane"),
        beyond=some("beyond"),
        solved_cells=some("solved_cells"),
        depth=0 if all(scope.depth == 0 for scope in scopes) else None,
    )
