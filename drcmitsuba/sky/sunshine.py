"""A dynamic sky from monthly sunshine: each time draws one of gensky's CIE skies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.cie import CieSky
from drcmitsuba.sky.quadrature import PATCH_MEANS, PatchValues, SkyLight

MINUTES = 366 * 24 * 60


@dataclass(frozen=True)
class Sunshine:
    """Random sequence of CIE skies after monthly sunshine probabilities [1]_.

    Parameters
    ----------
    probability : tuple of 12 floats
        Share of the daylight hours with sunshine in each month, January first, 0 to 1.
    intermediate : float
        Share of the sunless skies that are intermediate instead of overcast, 0 to 1.
    seed : int
        Seed of the random numbers; the same seed gives the same skies.
    turbidity : float
        Linke turbidity of the clear and intermediate skies.
    patch_values : PatchMeans or PatchCentres
        How the continuous sky becomes one luminance per patch.

    Raises
    ------
    InputError
        There are not 12 probabilities from 0 to 1, or `intermediate` is not from 0 to 1.

    Notes
    -----
    A time in month m has the clear sky with sun with probability p_m; otherwise it has the
    intermediate sky without sun with the share `intermediate`, or the overcast sky. The share, a
    half, is ours: [1]_ names the three skies but not how the sunless ones are mixed.
    A draw belongs to the minute of the year, not to the place in the series: the same time has the
    same sky in any period and order of times. Draws of different times are independent: the sky has
    no persistence as weather has.

    References
    ----------
    .. [1] C. Bauer, S. Wittkopf, "Annual daylight simulations with EvalDRC", 2015, section 3.2 b.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> from drcmitsuba import sky
    >>> weather = drcmitsuba.weather.default()
    >>> times = np.array(["2015-03-20T09", "2015-03-20T12"], "datetime64[ns]")
    >>> sun = sky.sun_position(times, 1.0, weather.site)
    >>> L = sky.radiance(weather.data.sel(time=times), sun, model=sky.Sunshine((0.4,) * 12))
    >>> bool((L["sky"] > 0).all())
    True
    """

    probability: tuple[float, ...]
    intermediate: float = 0.5
    seed: int = 0
    turbidity: float = 2.45
    patch_values: PatchValues = PATCH_MEANS

    def __post_init__(self) -> None:
        if len(self.probability) != 12:
            got = f"{len(self.probability)} values"
            raise InputError("sunshine sky", "probability", got, "give 12, January first")
        if self.seed < 0:
            raise InputError("sunshine sky", "seed", f"{self.seed}", "give a number from 0")
        shares = {"probability": self.probability, "intermediate": (self.intermediate,)}
        for name, values in shares.items():
            wrong = [p for p in values if not 0 <= p <= 1]
            if wrong:
                raise InputError("sunshine sky", name, str(wrong[0]), "give shares from 0 to 1")

    def luminances(self, data: xr.Dataset, sun: xr.Dataset, patches: Patches) -> SkyLight:
        """Sky and direct light of each time, as `SkyModel` says."""
        drawn = self.kinds((data["start"] if "start" in data.coords else sun["time"]).to_numpy())
        n = len(drawn)
        light = SkyLight(
            np.zeros((n, len(self.patch_values.horizontal(patches)))), np.zeros(n), np.zeros(n)
        )
        for kind in np.unique(drawn):
            model = CieSky(str(kind), turbidity=self.turbidity, patch_values=self.patch_values)
            at = np.flatnonzero(drawn == kind)
            of_kind = model.luminances(data.isel(time=at), sun.isel(time=at), patches)
            for whole, part in zip(light, of_kind, strict=True):
                whole[at] = part
        return light

    def kinds(self, time: np.ndarray) -> np.ndarray:
        """Name of the CIE sky drawn for each datetime64 stamp, shape (time,)."""
        minute = (time.astype("datetime64[m]") - time.astype("datetime64[Y]")).astype(int)
        month = time.astype("datetime64[M]").astype(int) % 12
        generator = np.random.Generator(np.random.Philox(self.seed))
        draw = generator.random(MINUTES)[minute]
        p = np.array(self.probability)[month]
        sunless = np.where(draw < p + (1 - p) * self.intermediate, "intermediate", "overcast")
        return np.where(draw < p, "clear_with_sun", sunless)
