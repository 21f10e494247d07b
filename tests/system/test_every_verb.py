"""Every verb on every kind of room."""

import pytest

from drcmitsuba.annual.tradeoff import run as tradeoff
from drcmitsuba.annual.tradeoff import settings
from tests.system.every_room import BOXES, MODELS, of_another_pane, write_models

pytestmark = pytest.mark.slow

CASES = BOXES | MODELS
DESIGN = """[design]
{side}film = "opal"
starts = 1
sharpness = [8.0]
pareto = 2
"""
VERBS = {
    "evaluate": ("case.toml", "-o", "results"),
    "plan": ("case.toml",),
    "season": ("case.toml", "-o", "season"),
    "lights": ("case.toml", "--point", "2,2", "-o", "lights"),
    "comply": ("results",),
    "report": ("results", "-o", "report.html"),
    "export": ("case.toml", "--radiance", "radiance"),
    "render": ("case.toml", "--time", "03-21 12:00", "--size", "32", "--samples", "2",
               "-o", "pictures"),
    "glare": ("case.toml", "-o", "glare"),
    "variants": ("case.toml", "--variants", "other", "-o", "variants"),
    "study": ("study.toml", "-o", "study"),
    "tradeoff": ("case.toml", "--minutes", "10", "-o", "tradeoff"),
    "optimise": ("design.toml", "-o", "optimum"),
}  # fmt: skip


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folder of each case with its variant, its study and its design."""
    out = {}
    for name, text in CASES.items():
        folder = out[name] = tmp_path_factory.mktemp(name.replace(" ", "_"))
        write_models(folder)
        design = DESIGN.format(side='side = "south"\nrows = 2\n' if "[facade" in text else "")
        (folder / "case.toml").write_text(f'name = "{name}"\n{text}')
        (folder / "other.toml").write_text(f'name = "{name} other"\n{of_another_pane(text)}')
        (folder / "design.toml").write_text(f'name = "{name}"\n{text}{design}')
        pane = "glass" if "materials.glass" in text else "pane_1"
        grid = f'[grid]\n"materials.{pane}.transmittance" = [0.5, 0.7]\n'
        (folder / "study.toml").write_text(f'case = "case.toml"\n{grid}')
    return out


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    """Trade-offs of one setting, whose references have the least rounds, however long."""
    whole = settings.design
    monkeypatch.setattr(tradeoff, "SHARE_OF_REFERENCE", 0.01)
    monkeypatch.setattr(tradeoff, "design", lambda *a, **k: whole(*a, **k)[:1])


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("name", CASES)
def test_every_verb_opens_every_case(run, monkeypatch, folders, name, verb):
    monkeypatch.chdir(folders[name])
    if VERBS[verb][0] == "results" and not (folders[name] / "results").exists():
        run("evaluate", *VERBS["evaluate"])
    code, _, err = run("evaluate" if verb == "variants" else verb, *VERBS[verb])
    assert code == 0, err


@pytest.mark.parametrize("name", CASES)
def test_a_design_stops_no_other_verb(run, monkeypatch, folders, name):
    monkeypatch.chdir(folders[name])
    code, _, err = run("plan", "design.toml")
    assert code == 0, err
