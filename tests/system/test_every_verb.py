"""Every verb on every kind of room: what it gives, or the one line that says why not."""

import pytest

pytestmark = pytest.mark.slow

ROOM = """
[period]
months = [3]
days_per_week = 1
[room]
size = [4.0, 5.0, 3.0]
{room}
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.opal]
type = "diffuser"
transmittance = 0.5
[materials.shade]
type = "diffuser"
transmittance = 0.1
[sensors]
corner = [0.5, 0.5, 0.8]
count = [3, 3]
spacing = 1.2
[accuracy]
replicates = 2
paths = 16
[views.desk]
position = [2.0, 2.0, 1.2]
direction = [0.0, -1.0, 0.0]
"""
SHADING = '[shading]\nmaterial = "shade"\ngroups = "together"\n'
SOUTH = '[facade.south]\nstrips = [{ bottom = 0.9, top = 2.4, material = "glass" }]\n'
WEST = SOUTH.replace("south", "west")
FILM = """[facade.south]
strips = [{ bottom = 0.9, top = 1.8, material = "glass" },
          { bottom = 1.8, top = 2.4, material = "opal" }]
"""
GROUPS = """[groups.south]
panes = ["glass"]
facing = "south"
states = ["opal", "shade"]
[groups.west]
panes = ["glass"]
facing = "west"
states = ["shade"]
"""
PIPE = """[materials.silver]
type = "mirror"
reflectance = 0.95
[components.pipe]
type = "lightpipe"
centre = [2.0, 3.5]
width = 0.4
height = 1.0
mirror = "silver"
"""
PLAIN = ROOM.format(room="")
CASES = {
    "box": PLAIN + SHADING + SOUTH,
    "two sides": PLAIN + SHADING + SOUTH + WEST,
    "film beside glass": PLAIN + SHADING + FILM,
    "groups": PLAIN + SOUTH + WEST + GROUPS,
    "component": PLAIN + SHADING + SOUTH + PIPE,
    "coloured": ROOM.format(room="floor = [0.4, 0.2, 0.1]") + SHADING + SOUTH,
}
DESIGN = """[design]
side = "south"
film = "opal"
rows = 2
starts = 1
sharpness = [8.0]
pareto = 2
"""
REFUSED = {
    ("groups", "variants"): "groups of panes in variants",
    ("groups", "optimise"): "knows one shade for all panes",
}
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
    "optimise": ("design.toml", "-o", "optimum"),
}  # fmt: skip


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folder of each case with its variant, its study and its design."""
    out = {}
    for name, text in CASES.items():
        folder = out[name] = tmp_path_factory.mktemp(name.replace(" ", "_"))
        other = text.replace('material = "glass" }]', 'material = "opal" }]', 1)
        (folder / "case.toml").write_text(f'name = "{name}"\n{text}')
        (folder / "other.toml").write_text(f'name = "{name} other"\n{other}')
        (folder / "design.toml").write_text(f'name = "{name}"\n{text}{DESIGN}')
        grid = '[grid]\n"materials.glass.transmittance" = [0.5, 0.7]\n'
        (folder / "study.toml").write_text(f'case = "case.toml"\n{grid}')
    return out


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("name", CASES)
def test_every_verb_opens_every_case(run, monkeypatch, folders, name, verb):
    monkeypatch.chdir(folders[name])
    if VERBS[verb][0] == "results" and not (folders[name] / "results").exists():
        run("evaluate", *VERBS["evaluate"])
    code, _, err = run("evaluate" if verb == "variants" else verb, *VERBS[verb])
    words = REFUSED.get((name, verb))
    assert code == (0 if words is None else 2), err
    assert words is None or words in " ".join(err.split())
