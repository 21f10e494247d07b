"""A small room with a film, for tests of films as design variables."""

import numpy as np

from drcmitsuba import load_case
from drcmitsuba.design.film import MeasuredFilm, ParametricFilm
from tests import ROOT

PRISM = ROOT / "scenes" / "films" / "prism.xml"
CASE = f"""
name = "small room"
[period]
months = [3]
hours = [8, 13]
days_per_week = 1
[room]
size = [4.0, 5.0, 3.0]
rotation = 0.0
[facade.south]
segments = 2
frame = 0.1
strips = [
    {{ bottom = 0.9, top = 1.8, material = "glass" }},
    {{ bottom = 1.8, top = 2.7, material = "film" }},
]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.film]
type = "bsdf"
file = "{PRISM}"
straight_through = "off"
[materials.shade]
type = "diffuser"
transmittance = 0.1
reflectance = 0.4
[shading]
material = "shade"
[[furniture]]
name = "desk"
corner = [1.0, 1.5, 0.7]
size = [1.6, 0.8, 0.0]
[sensors]
corner = [0.6, 0.6, 0.8]
count = [4, 4]
spacing = 0.7
[accuracy]
replicates = 8
seed = 3
"""
SUN = np.array([[0.07, -0.8, 0.6], [0.48, -0.64, 0.6], [-0.2, -0.3, 0.93], [0.0, 0.8, 0.6]])
"""The last one is behind a façade that faces south."""
SOUTH = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
"""Frame of such a façade's panes: x is y × z."""
PRISM_FILM = MeasuredFilm(PRISM)


def case_of(folder, *changes):
    text = CASE
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} does not name one place"
        text = text.replace(old, new)
    file = folder / "case.toml"
    file.write_text(text)
    return load_case(file)


def other_film():
    return ParametricFilm(0.5, 0.9, -10.0, 12.0)
