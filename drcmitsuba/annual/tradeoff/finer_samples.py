"""The reference of a case with mirrors or clear solids: the program's own estimator, much finer.

Paths from a sensor find the sun behind mirrors by chance alone, so photons have to do it here, too.
Rounds have other random numbers, finer patches of the sky and smaller cells than any setting has by
default, and light between surfaces follows paths: what is shared is the method, which
`docs/validation` checks against exact answers.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from drcmitsuba.annual.result import Result, evaluate_within
from drcmitsuba.annual.tradeoff.reference import (
    ENOUGH,
    FEWEST_ROUNDS,
    Reference,
    illuminances,
    number_of_states,
    some_sensors,
    spread,
)
from drcmitsuba.annual.tradeoff.settings import default, times_samples
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components import place
from drcmitsuba.sky.daylight import Daylight, daylight

REPLICATES, SAMPLES = 2, 4
"""Number of replicates in a round, and factor of the samples of each."""
MOST_PHOTONS = 64
"""Largest factor of the photons from the sky in all rounds; there are four rounds or more."""
SUBDIVISION = 2
"""Reinhart's factor of the sky."""
CELLS = 0.3
"""Edge of the cells [m]; less in small rooms."""
LONGER = 1.5
"""Largest time that four rounds take, over the time that is left to the reference [–]."""
SEEDS, MOST_SEED = 1009, 1 << 30
"""Distance of the rounds' seeds, and the end of their range."""


def is_called_for(case: Case) -> bool:
    """Whether some component sends light on by other than diffuse reflection."""
    surfaces = (surface for component in place(case) for surface in component.surfaces)
    return any(not isinstance(surface.material, Lambertian) for surface in surfaces)


def sample_reference(case: Case, times: np.ndarray, until: float) -> Reference:
    """Evaluate the reference at `times` (time,), in rounds until a time by `time.monotonic` [s].

    Four rounds are evaluated, even if they take up to half as long again.

    Raises
    ------
    InputError
        The first rounds tell that they take longer.
    """
    start = time.monotonic()
    backend.select()
    sensors, rounds = some_sensors(case), list[tuple[np.ndarray, ...]]()
    while True:
        begin = time.monotonic()
        finer = _finer(case, len(rounds))
        result = evaluate_within(finer, light=_at(daylight(finer), times))
        assert isinstance(result, Result)
        E = result.illuminance
        total, is_open, direct = illuminances(E)
        state = number_of_states(case, E)
        rounds.append((total[:, sensors], is_open[:, sensors], direct, state))
        done, pace = len(rounds), time.monotonic() - begin
        if done < FEWEST_ROUNDS:
            spent = time.monotonic() - start
            took = spent + (FEWEST_ROUNDS - done) * pace
            # The first round compiles, which tells nothing of the pace.
            if (spent if done == 1 else took) > LONGER * (until - start):
                minutes = math.ceil(took / 60)
                got = f"the reference alone takes about {minutes} min"
                remedy = f"give --minutes {2 * minutes} or more"
                raise InputError("tradeoff", "minutes", got, remedy)
            continue
        enough = done % FEWEST_ROUNDS == 0 and spread([E for _, E, *_ in rounds]) < ENOUGH
        if enough or _photons(case, done) >= MOST_PHOTONS or time.monotonic() + pace > until:
            break
    total, is_open, direct, states = map(np.stack, zip(*rounds, strict=True))
    # Where rounds do not agree, E is compared with all groups open.
    state = np.where((states == states[0]).all(axis=0), states[0], -1)
    method = (
        f"the program's own estimator with {_photons(case, done):.0f} × the default setting's "
        f"photons from the sky, at {len(sensors)} sensors"
    )
    return Reference(
        times, sensors, is_open, total, direct.mean(axis=0), state, method,
        time.monotonic() - start,
    )  # fmt: skip


def _photons(case: Case, rounds: int) -> float:
    """Photons from the sky in so many rounds, over those of the default setting."""
    replicates = default(case).accuracy.replicates
    return SAMPLES * rounds * REPLICATES / replicates


def _finer(case: Case, number: int) -> Case:
    """Case of a round, with random numbers of its own."""
    base = default(case)
    own = {
        "replicates": REPLICATES,
        "cell_size": min(CELLS, 2 / 3 * base.accuracy.cell_size),
        "seed": (base.accuracy.seed + SEEDS * (number + 1)) % MOST_SEED,
    }
    return base.with_tables(
        accuracy=times_samples(base.accuracy, SAMPLES).model_copy(update=own),
        sky=base.sky.model_copy(update={"subdivision": SUBDIVISION}),
        effects=base.effects.model_copy(update={"solved_cells": "off"}),
        output=base.output.model_copy(update={"illuminance": "auto"}),
    )


def _at(light: Daylight, times: np.ndarray) -> Daylight:
    """Daylight of some of its time stamps."""
    sky = light.sky.sel(time=times)
    suns = light.suns.only(sky["sun_bin"].values)
    return replace(light, sky=sky, sun=light.sun.sel(time=times), suns=suns)
