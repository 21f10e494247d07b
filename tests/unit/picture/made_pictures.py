"""Pictures that tests draw: disks and windows in a uniform surrounding."""

import numpy as np

from drcmitsuba.picture import Picture, PictureView


def fisheye(*draws, kind="equidistant", size=240, base=500.0, angle=180.0):
    """Fisheye picture along +y of a luminance [cd/m²] in which each of `draws` draws."""
    view = PictureView(kind, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (angle, angle))
    directions = view.pixel_directions(size, size)
    luminance = np.full((size, size), float(base))
    with np.errstate(invalid="ignore"):
        for draw in draws:
            draw(luminance, directions)
    luminance[~np.isfinite(directions[..., 0])] = 0
    return Picture(np.repeat(luminance[..., None], 3, axis=2).astype(np.float32), view)


def disk(azimuth, elevation, radius, value):
    """Disk of a luminance at angles [deg] to the right of and above the line of sight."""
    a, e = np.radians([azimuth, elevation])
    centre = np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])

    def draw(luminance, directions):
        luminance[directions @ centre > np.cos(np.radians(radius))] = value

    return draw


def halo(azimuth, elevation, width, value):
    """Glow around a direction that falls off as a normal distribution of a width [deg]."""
    a, e = np.radians([azimuth, elevation])
    centre = np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])

    def draw(luminance, directions):
        angle = np.degrees(np.arccos(np.clip(directions @ centre, -1, 1)))
        luminance += np.nan_to_num(value * np.exp(-((angle / width) ** 2)))

    return draw


def window(left, right, bottom, top, value):
    """Rectangle in azimuth and elevation [deg]."""

    def draw(luminance, directions):
        azimuth = np.degrees(np.arctan2(directions[..., 0], directions[..., 1]))
        elevation = np.degrees(np.arcsin(directions[..., 2]))
        across = (azimuth > left) & (azimuth < right)
        luminance[across & (elevation > bottom) & (elevation < top)] = value

    return draw


def sky(zenith):
    """Sky that brightens from a zenith luminance [cd/m²] to three times that at the horizon."""

    def draw(luminance, directions):
        up = directions[..., 2]
        luminance[up > 0] = (zenith * (3 - 2 * up))[up > 0]

    return draw
