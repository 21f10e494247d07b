"""Sky: from weather, period and sky model to the luminances L[time, bin] of every bin.

weather
    Weather files: irradiances of every interval of a nominal year.
consistency
    Whether a weather file agrees with itself.
period
    Time stamps that are evaluated.
sun
    `sun_position`: where the sun stands in each interval.
perez, cie, sunshine
    Sky models: all-weather sky from irradiances, standard skies, skies drawn from sunshine hours.
quadrature
    From a continuous sky to one luminance per patch.
sky_model
    `radiance`: luminances of patches, ground and sun.
sun_models
    Which suns stand for the sun of every time stamp.
remarks, daylight
    Sky and suns of a case, with remarks on its period.
luminances
    L[time, bin] of all bins, suns among them.
"""

from drcmitsuba.sky.cie import CieSky
from drcmitsuba.sky.perez import Perez
from drcmitsuba.sky.quadrature import AtDirections, PatchCentres, PatchMeans
from drcmitsuba.sky.sky_model import SkyModel, radiance, sun_labels
from drcmitsuba.sky.sun import sun_position
from drcmitsuba.sky.sunshine import Sunshine

__all__ = [
    "AtDirections",
    "CieSky",
    "PatchCentres",
    "PatchMeans",
    "Perez",
    "SkyModel",
    "Sunshine",
    "radiance",
    "sun_labels",
    "sun_position",
]
