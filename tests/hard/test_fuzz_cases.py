"""Case files, valid and damaged: a result, or one line that says what is wrong; nothing else."""

import copy
import shutil

import pytest
from hypothesis import given, settings

from drcmitsuba.case.reading import load_case
from drcmitsuba.case.shipped import shipped_folder
from tests.hard.command_line import GIB, no_more_than
from tests.hard.generated_cases import TINY, cases, furnish, shipped
from tests.hard.mutations import FUZZING, toml
from tests.hard.readers import outcome


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of the case, beside the files that it names."""
    folder = tmp_path_factory.mktemp("cases")
    furnish(folder)
    return folder


def loaded(path):
    """Whether a case loads; one line says what is wrong with it, whatever it is."""
    with no_more_than(GIB):
        return "result" if outcome(load_case, path) == "result" else "refused"


def load_many(folder, tally, examples):
    @settings(max_examples=examples, **FUZZING)
    @given(cases())
    def one(text):
        (folder / "case.toml").write_bytes(text)
        tally[loaded(folder / "case.toml")] += 1

    one()


def test_a_case_loads_or_is_refused_in_one_line(folder, tally):
    load_many(folder, tally, 80)


@pytest.mark.slow
def test_many_cases_load_or_are_refused_in_one_line(folder, tally):
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


def test_a_changed_shipped_case_loads_or_is_refused_in_one_line(tmp_path, tally):
    load_shipped(tmp_path, tally, 40)


@pytest.mark.slow
def test_many_changed_shipped_cases_load_or_are_refused_in_one_line(tmp_path, tally):
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


def test_a_case_has_a_result_or_is_refused_in_one_line(command, folder, tally, holds):
    evaluate_some(command, folder, tally, holds, 4)


@pytest.mark.slow
def test_many_cases_have_a_result_or_are_refused_in_one_line(command, folder, tally, holds):
    evaluate_some(command, folder, tally, holds, 1000)


# Failures that fuzzing brought up

GLAZED = {
    "room": {"size": [4.0, 5.0, 3.0]},
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.65},
        "film": {"type": "bsdf", "file": "even.xml"},
        "silver": {"type": "mirror", "reflectance": 0.9},
    },
    "facade": {
        "south": {
            "strips": [
                {"bottom": 0.9, "top": 1.8, "material": "glass"},
                {"bottom": 1.8, "top": 2.7, "material": "film"},
            ]
        }
    },
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 2], "spacing": 0.6},
    "period": {"timestamps": "stamps.csv"},
    "accuracy": TINY,
}
NAMES = {
    "a formula": "$\\frac{$",  # matplotlib took it for mathematics
    "markup": "[/x]",  # so did rich
    "a sun": "Büro \U0001f31e",  # the font has none, and matplotlib said so on stderr
    "empty": "",
}


def changed(**tables):
    return copy.deepcopy(GLAZED) | tables


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_a_name_is_only_a_name(name, command, folder):
    (folder / "case.toml").write_text(toml(changed(name=name)), encoding="utf-8")
    assert command("evaluate", "case.toml", "-o", "results", folder=folder).line == ""


REFUSED = {
    "a name of 5000 letters": ({"name": "x" * 5000}, "name"),  # as high a picture
    "a type of 5000 letters": ({"materials": {"glass": {"type": "x" * 5000}}}, "materials.glass"),
    "cells of nothing": ({"accuracy": TINY | {"cell_size": 1e-300}}, "accuracy.cell_size"),
    "half a million patches": ({"accuracy": TINY | {"cell_size": 1e-3}}, "accuracy.cell_size"),
    "a hundred million cells": ({"accuracy": TINY | {"cell_size": 0.011}}, "accuracy.cell_size"),
    "more light than float32 has": ({"metrics": {"sda_threshold": 1e300}}, "metrics.sda_thresh"),
    "endless hours": ({"metrics": {"ase_hours": 1e300}}, "metrics.ase_hours"),
    "a shade that waits for ever": (
        {"shading": {"material": "film", "threshold": 1e300}}, "shading.threshold",
    ),
    "the brightest sky": (
        {"sky": {"model": "cie", "type": 16, "diffuse_horizontal_illuminance": 1e300}},
        "sky.diffuse_horizontal_illuminance",
    ),
    "a pipe of nothing": (
        {"components": {"pipe": {
            "type": "lightpipe", "centre": [1.0, 1.0], "width": 1e-300, "height": 1.0,
            "mirror": "silver",
        }}}, "components.pipe.width",
    ),
    "a file name of 5000 letters": (
        {"facade": {}, "materials": {"film": {"type": "bsdf", "file": "x" * 5000}}},
        "materials.film.file",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("tables", "field"), REFUSED.values(), ids=REFUSED)
def test_what_broke_is_refused(tables, field, command, folder, holds):
    (folder / "case.toml").write_text(toml(changed(**tables)), encoding="utf-8")
    answer = command("evaluate", "case.toml", "-o", "results", folder=folder)
    assert field in answer.line.split(": ", 1)[1]
    holds("memory, of 1 GiB", max(0, answer.growth) / GIB, 1)


def test_a_night_behind_two_films_is_dark(command, folder):
    """No sun shines on any film: tables of nothing were put together."""
    strips = {"strips": [{"bottom": 0.0, "top": 1.0, "material": "film"}]}
    night = {"months": [1], "hours": [0, 1], "days_per_week": 1}
    case = changed(facade={"south": strips, "east": strips}, period=night)
    (folder / "case.toml").write_text(toml(case), encoding="utf-8")
    assert command("evaluate", "case.toml", "-o", "results", folder=folder).line == ""


@pytest.mark.slow
def test_a_hundred_thousand_desks(command, folder):
    """Drawn one by one on the plans they took minutes."""
    desks = {
        "corner": [1.9, 1.9, 0.0], "size": [0.5, 0.5, 0.5], "count": [1000, 100],
        "step": [0.6, 0.6],
    }  # fmt: skip
    (folder / "case.toml").write_text(toml(changed(furniture=[desks])))
    assert command("evaluate", "case.toml", "-o", "results", folder=folder).line == ""
