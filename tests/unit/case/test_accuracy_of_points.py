"""Few points take more samples, unless the case states them."""

from drcmitsuba.case.accuracy import POINTS, Accuracy


def test_as_many_points_as_the_defaults_are_made_for_take_the_defaults():
    for count in (POINTS, 5 * POINTS):
        assert Accuracy().of_points(count) == Accuracy()


def test_few_points_take_more_paths():
    usual, half, few = Accuracy(), Accuracy().of_points(POINTS // 2), Accuracy().of_points(1)
    assert half.paths == 2 * usual.paths
    assert few.paths == 64 * usual.paths
    assert few.cell_paths == 2 * usual.cell_paths
    assert (few.replicates, few.cell_size) == (usual.replicates, usual.cell_size)


def test_what_a_case_states_stays():
    stated = Accuracy(paths=128).of_points(2)
    assert stated.paths == 128
    assert stated.cell_paths > Accuracy().cell_paths
