"""Case files, valid and damaged: a result, or one line that says what is wrong; nothing else."""

import shutil

import pytest
from hypothesis import given, settings

from drcmitsuba.case import load_case, shipped_folder
from tests.hard.command_line import GIB, no_more_than
from tests.hard.generated_cases import cases, furnish, shipped
from tests.hard.mutations import FUZZING
from tests.hard.readers import outcome


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of the case, beside the files that it names."""
    folder = tmp_path_factory.mktemp("cases")
    furnish(folder)
    return folder


def loaded(path):
    """Whether a case loads; what is wrong with it is told in one line, whatever it is."""
    with no_more_than(GIB):
        return "result" if outcome(load_case, path) == "result" else "refused"


def load_many(folder, tally, examples):
    @settings(max_examples=examples, **FUZZING)
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

    @settings(max_examples=examples, **FUZZING)
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


def evaluate_some(command, folder, tally, holds, examples):
    growth = []

    @settings(max_examples=examples, **FUZZING)
    @given(cases(whole=14))
    def one(text):
        (folder / "case.toml").write_bytes(text)
        answer = command("evaluate", "case.toml", "-o", "results", folder=folder)
        tally["refused" if answer.line else "result"] += 1
        growth.append(answer.growth)

    one()
    holds("memory that one evaluation takes, of 1 GiB", max(growth) / GIB, 1)


def test_a_case_has_a_result_or_is_told_in_one_line(command, folder, tally, holds):
    evaluate_some(command, folder, tally, holds, 15)


@pytest.mark.slow
def test_many_cases_have_a_result_or_are_told_in_one_line(command, folder, tally, holds):
    evaluate_some(command, folder, tally, holds, 1000)
