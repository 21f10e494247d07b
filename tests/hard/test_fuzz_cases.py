"""Case files, valid and damaged: a result, or one line that says what is wrong; nothing else."""

import shutil
from collections import Counter

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from drcmitsuba.case import load_case, shipped_folder
from drcmitsuba.errors import InputError
from tests.hard.command_line import GIB, CommandLine, no_more_than
from tests.hard.generated_cases import cases, furnish, shipped

LEAST_VALID = 0.3
"""Share of the generated inputs that have to give a result."""
COMMON = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "phases": (Phase.explicit, Phase.generate, Phase.shrink),
    "suppress_health_check": list(HealthCheck),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of the case, beside the files that it names."""
    folder = tmp_path_factory.mktemp("cases")
    furnish(folder)
    return folder


@pytest.fixture(scope="module")
def drcmitsuba():
    """The command line, in a process that stays."""
    process = CommandLine()
    yield process
    process.close()


@pytest.fixture
def tally():
    """Count what came, and assert that enough of it had a result."""
    counts = Counter()
    yield counts
    print(dict(counts))
    assert counts["result"] >= LEAST_VALID * (counts["result"] + counts["refused"]), counts


def loaded(path):
    """Whether a case loads; what is wrong with it is told in one line, whatever it is."""
    try:
        with no_more_than(GIB):
            load_case(path)
    except InputError as error:
        assert str(error).isprintable()
        assert len(str(error)) < 1000
        return "refused"
    return "result"


def load_many(folder, tally, examples):
    @settings(max_examples=examples, **COMMON)
    @given(cases())
    def one(text):
        (folder / "case.toml").write_bytes(text)
        tally[loaded(folder / "case.toml")] += 1

    one()


def test_a_case_loads_or_is_told_in_one_line(folder, tally):
    load_many(folder, tally, 300)


@pytest.mark.slow
def test_many_cases_load_or_are_told_in_one_line(folder, tally):
    load_many(folder, tally, 10_000)


def load_shipped(tmp_path, tally, examples):
    shutil.copytree(shipped_folder(), tmp_path, dirs_exist_ok=True)

    @settings(max_examples=examples, **COMMON)
    @given(shipped())
    def one(drawn):
        name, text = drawn
        path = (tmp_path / name).with_name("changed.toml")
        path.write_bytes(text)
        tally[loaded(path)] += 1

    one()


def test_a_changed_shipped_case_loads_or_is_told_in_one_line(tmp_path, tally):
    load_shipped(tmp_path, tally, 150)


@pytest.mark.slow
def test_many_changed_shipped_cases_load_or_are_told_in_one_line(tmp_path, tally):
    load_shipped(tmp_path, tally, 5000)


def evaluate_some(drcmitsuba, folder, tally, holds, examples):
    growth = []

    @settings(max_examples=examples, **COMMON)
    @given(cases())
    def one(text):
        (folder / "case.toml").write_bytes(text)
        answer = drcmitsuba("evaluate", "case.toml", "-o", "results", folder=folder)
        tally["refused" if answer.line else "result"] += 1
        growth.append(answer.growth)

    one()
    holds("memory that one evaluation takes, of 1 GiB", max(growth) / GIB, 1)


def test_a_case_has_a_result_or_is_told_in_one_line(drcmitsuba, folder, tally, holds):
    evaluate_some(drcmitsuba, folder, tally, holds, 15)


@pytest.mark.slow
def test_many_cases_have_a_result_or_are_told_in_one_line(drcmitsuba, folder, tally, holds):
    evaluate_some(drcmitsuba, folder, tally, holds, 1000)
