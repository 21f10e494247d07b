"""`drcmitsuba optimise` with hours of glare, as a user runs it: its verdict afresh."""

import json

import pytest

from tests.system.every_room import MODELS, write_models
from tests.unit.design.test_facade_glare import case_in


@pytest.mark.slow
@pytest.mark.parametrize("objective", ['objective = "glare"\n', "glare_limit = 10.0\n"])
def test_the_command_tells_the_hours_of_glare_afresh(run, tmp_path, objective):
    file = case_in(tmp_path, objective)
    code, out, err = run("optimise", file, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "hours with DGP above 0.40 at " in out
    assert ("the limit of 10 %" in out) == ("limit" in objective)
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    if "limit" in objective:
        assert optimum["glare"] <= 10
        assert optimum["feasible"]
    else:
        assert optimum["without_glare"] == pytest.approx(100 - optimum["glare"])


@pytest.mark.slow
def test_panes_of_a_model_are_searched_by_the_hours_of_glare(run, tmp_path):
    write_models(tmp_path)
    design = '[design]\nfilm = "opal"\nase_limit = 100.0\npareto = 0\nsharpness = [8.0]\n'
    text = f'{MODELS["mesh"]}{design}iterations = 4\nobjective = "glare"\n'
    (tmp_path / "case.toml").write_text(text)
    code, out, err = run("optimise", tmp_path / "case.toml", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "hours with DGP above 0.40 at desk, the worst view: " in out
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    assert 0 <= optimum["glare"] <= 100
