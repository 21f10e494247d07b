"""The small room of the tests of evaluations, and how its text is changed."""

import re

from drcmitsuba.cli import main

CASE = """
name = "small room"
[period]
months = [3, 6]
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
segments = 2
frame = 0.1
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.shade]
type = "diffuser"
transmittance = 0.1
[sensors]
corner = [0.5, 0.5, 0.8]
count = [5, 5]
spacing = 0.6
[shading]
material = "shade"
[accuracy]
replicates = 4
paths = 32
cell_size = 0.6
cell_sky_rays = 16
sensor_sky_rays = 64
pane_points = 16
"""
SITE = "\n[site]\nlatitude = 46.25\nlongitude = 6.13\ntimezone = 1\n"
STRIPS = 'strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]'
SHADING = '[shading]\nmaterial = "shade"\n'
DAYS = "months = [3, 6]"
RESULTS = {
    "metrics.json", "plan.json", "illuminance.nc", "coefficients.zarr", "sky.zarr",
    "illuminance_plan.png", "autonomy_plan.png", "sun_plan.png", "monthly.png",
}  # fmt: skip
VARIABLES = {"total", "total_open", "sky_open", "sun_open", "direct_sun"}
SUN = re.compile(r"sun_2015-\d\d-\d\dT\d\d:\d\d")


def changed(*changes):
    text = CASE
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} does not name one place"
        text = text.replace(old, new)
    return text


def run(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["drcmitsuba", *map(str, arguments)])
    main.main()
