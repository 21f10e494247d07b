"""Variants of models of two rooms, whose panes differ: each against an evaluation of its own."""

import pytest

import drcmitsuba
from drcmitsuba.annual.variants import evaluate_variants
from drcmitsuba.runtime.errors import InputError
from tests.fast import slowly
from tests.system.every_room import MODELS, of_another_pane, write_models

FINER = "replicates = 2\npaths = 16", "replicates = 6\npaths = 48"


@pytest.fixture
def cases(tmp_path):
    """Case of a model and its variant, with changes of the latter's text."""
    write_models(tmp_path)

    def cases(name, *change):
        text = MODELS[name].replace(*FINER)
        other = text.replace(*change) if change else of_another_pane(text)
        for file, content in (("case", text), ("other", other)):
            (tmp_path / f"{file}.toml").write_text(content)
        return [drcmitsuba.load_case(tmp_path / f"{file}.toml") for file in ("case", "other")]

    return cases


@pytest.mark.parametrize("name", slowly(MODELS, "Radiance model with groups", "mesh"))
def test_variants_of_models_are_what_each_is_alone(cases, same, name):
    pair = cases(name)
    every = list(evaluate_variants(pair))
    for case, ours in zip(pair, every, strict=True):
        theirs = drcmitsuba.evaluate(case)
        C = [result.coefficients["replicates"] for result in (ours, theirs)]
        shared = [s for s in C[0]["state"].values if s in C[1]["state"].values]
        assert shared[0] == "open"
        assert len(shared) > 1 or not theirs.illuminance["shade_closed"].any()
        for state in shared:
            sky = [c.sel(state=state).isel(bin=slice(146)).sum("bin").values for c in C]
            same(sky[0], other=sky[1], within=0.01)
        E = [result.illuminance for result in (ours, theirs)]
        assert (E[0]["shade_closed"] != E[1]["shade_closed"]).sum() <= 1
        assert (E[0]["direct_sun"] >= 1000).equals(E[1]["direct_sun"] >= 1000)
    mean = [result.illuminance["total"].mean().item() for result in every]
    assert mean[1] > 1.02 * mean[0]  # milky panes need no blind


def test_groups_of_variants_may_differ(cases):
    pair = cases("Radiance model with groups", '["opal", "shade"]', '["opal"]')
    shares = [result.metrics["groups"]["first"] for result in evaluate_variants(pair)]
    assert [[*each] for each in shares] == [["open", "opal", "shade"], ["open", "opal"]]


MIRROR = '[materials.ceiling]\ntype = "mirror"\nreflectance = 0.5\n'


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("mesh", ("wall = 0.5", "wall = 0.4"), "model: differs from the first case's; variants"),
        (
            "Radiance model with groups",
            ("[materials.shade]", MIRROR + "[materials.shade]"),
            'materials.ceiling: "ceiling" differs from the first case\'s, and stands within rooms',
        ),
    ],
)
def test_variants_that_differ_elsewhere_are_refused(cases, name, change, message):
    with pytest.raises(InputError) as error:
        list(evaluate_variants(cases(name, *change)))
    assert message in str(error.value)
