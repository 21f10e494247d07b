"""A small room with a window to the south, and eyes that look round in it, for tests of glare."""

import numpy as np

from drcmitsuba import load_case

CASE = """
name = "office"
[period]
timestamps = "times.csv"
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
segments = 1
frame = 0.1
strips = [{{ bottom = 0.9, top = 2.6, material = "{material}" }}]
[materials.glass]
type = "glazing"
transmittance = 0.7
{more}
[sensors]
corner = [1.0, 1.0, 0.8]
count = [3, 3]
spacing = 0.8
[views.window]
position = [2.0, 1.8, 1.2]
direction = [0, -1, 0]
[views.side]
position = [2.0, 1.8, 1.2]
direction = [1, -1, 0]
[views.door]
position = [2.0, 1.8, 1.2]
direction = [0, 1, 0.2]
[accuracy]
replicates = 4
paths = 64
sensor_sky_rays = 1024
"""
TIMES = ("01-20T12:00", "03-21T09:00", "03-21T12:00", "06-21T15:00", "10-15T10:00", "12-21T13:00")


def case_in(folder, *, material="glass", more="", times=TIMES):
    """Load the room with its time stamps and further tables."""
    (folder / "times.csv").write_text("time\n" + "".join(f"2015-{t}\n" for t in times))
    file = folder / "office.toml"
    file.write_text(CASE.format(material=material, more=more), encoding="utf-8")
    return load_case(file)


def sum_over(pixels, L, forward):
    """Vertical illuminance by the pixels [lx], shape (hour,)."""
    cosine = np.maximum(pixels.directions @ forward, 0)
    return (cosine * pixels.tiles.by_pixel) @ L


def by_suns(known, forward):
    """Vertical illuminance by the images of the suns [lx], shape (hour,)."""
    images = known.seen.images
    if (known.sun_index < 0).all():
        return np.zeros(len(known.sun_index))
    cosine = np.maximum(images.direction @ forward, 0)
    each = cosine * images.solid_angle * images.transmittance
    by_sun = np.bincount(images.sun, each, known.sun_index.max() + 1)
    return np.where(known.sun_index >= 0, by_sun[known.sun_index] * known.sun, 0)
