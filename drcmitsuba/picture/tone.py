"""Pictures as a screen shows them: by an exposure, or as the eye would see the scene.

The eye's curve is Ward's histogram adjustment [1]_: brightness (the logarithm of luminance) is
spread over that of the screen by how much of the view has it, but nowhere with more contrast than
the eye would see in the scene. Pixels without light, as around a fisheye, count for neither.

References
----------
.. [1] G. Ward Larson, H. Rushmeier, C. Piatko, "A visibility matching tone reproduction operator
   for high dynamic range scenes", IEEE Transactions on Visualization and Computer Graphics 3(4),
   1997.
.. [2] J. Ferwerda, S. Pattanaik, P. Shirley, D. Greenberg, "A model of visual adaptation for
   realistic image synthesis", SIGGRAPH 1996.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.screen import SRGB, Screen
from drcmitsuba.runtime.errors import InputError

BLACK, WHITE = 1.0, 100.0
"""Luminances of the screen [cd/m²]."""
MIDDLE = (BLACK * WHITE) ** 0.5
"""Luminance of the screen for a scene of one luminance [cd/m²]."""
SAME = 1e-3
"""Difference of brightness below which a scene has one luminance [–]."""
DARKEST = 1e-4
"""Least luminance that the eye tells from black [cd/m²]."""
STEPS = 100
"""Number of steps of brightness of the histogram."""
FOVEA = 1.0
"""Angle over which the eye adapts [deg]."""
TOLERANCE = 0.025
"""Share of the view that may be left above the ceiling of contrast [–]."""


def exposed(picture: Picture, white: float | None = None, screen: Screen = SRGB) -> np.ndarray:
    """Picture in which a luminance is white, and brighter ones are cut off.

    Parameters
    ----------
    picture : Picture
        Picture.
    white : float, optional
        Luminance of white [cd/m²]; by default 98 % of the lit pixels are darker.
    screen : Screen
        Space of the colours, and what is white.

    Returns
    -------
    np.ndarray, shape (row, column, 3)
        Colours of the screen from 0 to 255, uint8.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> from drcmitsuba.picture import tone
    >>> tone.exposed(office, white=4000)[0, 0]
    array([99, 99, 99], dtype=uint8)
    """
    return screen.show(picture, exposure(picture, white)).pixels


def exposure(picture: Picture, white: float | None = None) -> np.ndarray:
    """Luminances of a picture over that of white [–], (row, column), as for `exposed`."""
    luminance = picture.luminance
    if white is None:
        lit = luminance[luminance > 0]
        white = float(np.quantile(lit, 0.98)) if len(lit) else 1.0
    if not 0 < white < np.inf:
        raise InputError("exposed", "white", f"{white}", "give cd/m² above 0")
    return np.asarray(luminance / white)


def human(picture: Picture, screen: Screen = SRGB) -> np.ndarray:
    """Picture as the eye would see the scene, on a screen of 1 to 100 cd/m².

    Parameters
    ----------
    picture : Picture
        Picture; without a view, it counts as 100 foveas wide.
    screen : Screen
        Space of the colours, and what is white.

    Returns
    -------
    np.ndarray, shape (row, column, 3)
        Colours of the screen from 0 to 255, uint8.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> from drcmitsuba.picture import tone
    >>> tone.human(office).dtype
    dtype('uint8')
    """
    return screen.show(picture, brightness(picture)).pixels


def brightness(picture: Picture) -> np.ndarray:
    """Luminances of a screen over that of its white [–], (row, column), as for `human`."""
    luminance = np.maximum(picture.luminance.astype(float), 0)
    edges, count = _histogram(_foveal(picture, luminance))
    if edges[-1] - edges[0] < SAME:
        return exposure(picture, float(np.exp(edges[-1])) * WHITE / MIDDLE)
    shown = np.interp(_brightness(luminance), edges, _curve(edges, count))
    return np.asarray((np.exp(shown) - BLACK) / (WHITE - BLACK))


def threshold(luminance: np.ndarray) -> np.ndarray:
    """Least difference of luminance [cd/m²] that an eye adapted to a luminance sees [2]_."""
    x = np.log10(np.maximum(luminance, 1e-12))
    pieces = [x < -3.94, x < -1.44, x < -0.0184, x < 1.9]
    values = [
        np.full_like(x, -2.86),
        np.maximum(0.405 * x + 1.6, 0) ** 2.18 - 2.86,
        x - 0.395,
        np.maximum(0.249 * x + 0.65, 0) ** 2.7 - 0.72,
    ]
    return 10 ** np.select(pieces, values, x - 1.255)


def _brightness(luminance: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(luminance, DARKEST))


def _foveal(picture: Picture, luminance: np.ndarray) -> np.ndarray:
    """Mean luminances of squares of the size of the fovea, without pixels that have no light."""
    rows, columns = picture.shape
    view = picture.view
    wide = view.angles[0] if view is not None and view.kind != "parallel" else 100 * FOVEA
    size = max(1, round(columns * FOVEA / wide))
    size = min(size, rows, columns)

    def summed(values: np.ndarray) -> np.ndarray:
        cut = values[: rows // size * size, : columns // size * size]
        return cut.reshape(rows // size, size, columns // size, size).sum(axis=(1, 3))

    count = summed((luminance > 0).astype(float))
    return summed(luminance)[count > 0] / count[count > 0]


def _histogram(foveal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the steps of brightness and their counts."""
    brightness = _brightness(foveal if len(foveal) else np.array([MIDDLE]))
    low, high = brightness.min(), brightness.max()
    if high - low < SAME:
        return np.array([low, high]), np.array([float(len(brightness))])
    count, edges = np.histogram(brightness, STEPS, (low, high))
    return edges, count.astype(float)


def _curve(edges: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Brightness of the screen at the edges of the steps.

    Counts above a ceiling are cut until few are left: the screen then shows no difference that the
    eye would not see in the scene. Where that leaves nothing, the scene fits the screen as it is,
    or has so few luminances that brightness is spread evenly.
    """
    step = edges[1] - edges[0]
    scene = np.exp((edges[1:] + edges[:-1]) / 2)
    span = np.log(WHITE / BLACK)
    allowed = TOLERANCE * count.sum()
    while True:
        total = count.sum()
        if total <= allowed:
            slope = min(1.0, span / (edges[-1] - edges[0]))
            return np.log(MIDDLE) + slope * (edges - (edges[0] + edges[-1]) / 2)
        filled = np.concatenate([[0], np.cumsum(count)]) / total
        curve = np.log(BLACK) + span * filled
        screen = np.exp((curve[1:] + curve[:-1]) / 2)
        steepest = threshold(screen) / screen / (threshold(scene) / scene)
        ceiling = steepest * total * step / span
        excess = np.maximum(count - ceiling, 0).sum()
        if excess <= allowed:
            return curve
        count = np.minimum(count, ceiling)
