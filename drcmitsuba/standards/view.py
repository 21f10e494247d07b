"""View out of EN 17037 at the points of a case, as far as geometry tells."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics.view_out import DISTANCES, LEVELS, WIDTHS

CRITERIA = ("width", "distance", "layers")


@dataclass(frozen=True)
class ViewOut:
    """Levels of the view out. No probability: rays to edges and things outside carry no noise."""

    points: int
    """Number of points."""
    share: dict[str, float]
    """Share of the points that reach each level, minimum, medium and high [%]."""
    criteria: dict[str, dict[str, float]]
    """The same of the width, the outside distance and the layers by themselves [%]."""
    median: dict[str, float]
    """Median over the points of the width [deg], the outside distance [m], which is infinite where
    nothing stands, and the number of layers [–]."""
    source: str = "climatestudiodocs.com, viewEN17037; read in public documentation"

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; a distance without end is null."""
        median = {k: v if np.isfinite(v) else None for k, v in self.median.items()}
        return asdict(self) | {"median": median}

    def text(self) -> list[str]:
        """Lines for people."""
        width, far, layers = (self.median[name] for name in CRITERIA)
        reached = ", ".join(f"{level} {share:.1f} %" for level, share in self.share.items())
        lines = [
            f"view out of EN 17037, as far as geometry tells: {reached} of {self.points} points",
            f"half of the points have a width of {width:.0f}° or more, "
            f"{'no end' if np.isinf(far) else f'{far:.3g} m'} outside, {layers:.0f} layers",
        ]
        for level, share in self.share.items():
            if share < 100:
                least = min(CRITERIA, key=lambda name: self.criteria[name][level])
                reach = self.criteria[least][level]
                lines.append(f"what decides {level}: the {least}, {reach:.1f} % of the points")
                break
        return lines


def view_out(distance: xr.DataArray) -> ViewOut:
    """Judge the view out of points by what `drcmitsuba.view_distances` sees.

    The standard asks for a view from the places where people are; which share of them has to reach
    a level could not be verified, so that shares stand for themselves.

    Parameters
    ----------
    distance : DataArray (sensor, azimuth, elevation)
        Distances beyond clear openings [m], as for `metrics.view_level`.

    Raises
    ------
    InputError
        As `metrics.view_level`.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("office.toml")
    >>> seen = drcmitsuba.view_distances(case, [(3.0, 1.0, 1.2)])
    >>> drcmitsuba.standards.view_out(seen).points
    1
    """
    level = metrics.view_level(distance).values
    width = metrics.sight_angle(distance).values
    far = metrics.outside_distance(distance).values
    seen = metrics.view_layers(distance)
    layers = seen.values.sum(axis=0) * seen.sel(layer="landscape").values
    share, criteria = {}, {name: {} for name in CRITERIA}  # type: ignore[var-annotated]
    for i, name in enumerate(LEVELS[1:]):
        share[name] = _percent(level > i)
        criteria["width"][name] = _percent(width >= WIDTHS[i])
        criteria["distance"][name] = _percent(far >= DISTANCES[i])
        criteria["layers"][name] = _percent(layers > i)
    # The lower median is a value of a point, also where others see without end.
    of_points = zip(CRITERIA, (width, far, layers), strict=True)
    median = {name: float(np.sort(values)[(len(values) - 1) // 2]) for name, values in of_points}
    return ViewOut(len(level), share, criteria, median)


def _percent(reached: np.ndarray) -> float:
    return 100 * float(reached.mean())
