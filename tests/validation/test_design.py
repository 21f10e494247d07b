"""The search for a façade against an exhaustive sweep, and against the named façades."""

import numpy as np
import pytest

from drcmitsuba import load_case
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.optimise import optimise
from drcmitsuba.runtime import backend

SHARES = np.arange(0, 1.001, 0.01)
PLACES = np.arange(0, 1.001, 0.1)


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def searched(name):
    layout = Layout.of(load_case(f"classroom/reference/{name}"))
    problem = layout.problem(layout.year())
    return problem, optimise(problem, layout.search, known=layout.known(problem))


@pytest.mark.slow
def test_the_film_is_the_best_of_a_sweep(capsys):
    """DWR in steps of 1 % at every tenth place, then every 1 % of place about the best."""
    problem, best = searched("sizing")
    rows = []

    def look(dwr, position):
        score = problem.evaluate(np.array([dwr, position]), 32.0).hard
        if problem.is_feasible(score):
            rows.append((score.value, dwr, position, score.aim, score.ase))

    assert [p.key for p in problem.free] == ["dwr", "position"]
    for dwr in SHARES:
        for position in PLACES:
            look(dwr, position)
    _, dwr, position, *_ = max(rows)
    for near in np.clip(np.arange(dwr - 0.03, dwr + 0.031, 0.01), 0, 1):
        for place in np.clip(np.arange(position - 0.1, position + 0.101, 0.01), 0, 1):
            look(near, place)
    value, dwr, position, aim, ase = max(rows)
    ours = problem.named(best.best.x)
    with capsys.disabled():
        print(
            f"\nsweep of {len(SHARES) * len(PLACES)} and near the best: DWR {dwr:.2f}, place "
            f"{position:.2f}, {value:.2f} (sDA {aim:.1f}, ASE {ase:.1f}); search: DWR "
            f"{ours['dwr'][0]:.3f}, place {ours['position'][0]:.3f}, {best.best.hard.value:.2f} "
            f"after {best.evaluations} evaluations in {best.seconds:.0f} s"
        )
    assert best.is_feasible
    one_sensor = 100 / 576
    assert best.best.hard.value >= value - one_sensor
    assert ours["dwr"][0] == pytest.approx(dwr, abs=0.05)


@pytest.mark.slow
def test_tiles_of_their_own_beat_the_named_facades(capsys):
    """36 tiles against glass all over, and the film of O2 and O3 in the same window."""
    problem, best = searched("tiles")
    bounds = problem.year.tiles.bounds
    middle = (bounds[:, 2] + bounds[:, 3]) / 2
    named = {}
    for name, low, high in (
        ("existing", 9, 9),
        ("O2", 2.7, 3.6),
        ("O3", 1.8, 2.7),
        ("O3 and O2", 1.8, 3.6),
    ):
        film = (middle > low) & (middle < high)
        share = np.zeros((len(film), len(problem.year.materials)), np.float32)
        share[:, problem.year.materials.index("glass")] = ~film
        share[:, problem.year.materials.index("film")] = film
        named[name] = problem.hard(share)
    with capsys.disabled():
        others = ", ".join(f"{n} {s.value:.2f} (ASE {s.ase:.1f})" for n, s in named.items())
        print(
            f"\n36 tiles: {best.best.hard.value:.2f} (ASE {best.best.hard.ase:.1f}) after "
            f"{best.evaluations} evaluations in {best.seconds:.0f} s; {others}"
        )
    assert best.is_feasible
    allowed = [s.value for s in named.values() if problem.is_feasible(s)]
    assert allowed
    assert best.best.hard.value > max(allowed)
