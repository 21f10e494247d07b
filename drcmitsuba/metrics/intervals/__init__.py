"""Intervals of the metrics: draws of sDA, ASE and the shade from the replicates of E.

rules
    Thresholds of the metrics, and the resolution of the draws.
reach
    Draws by how far they move an entry: most of them move none over a few standard errors.
bootstrap_counts
    Number of sensors that pass, in every draw.
sun, facade_draws, autonomy
    Draws of direct sun; of the state of the façade that follows; of sDA and msDA.
year_draws
    Counts that all draws of a year share.
spread
    Intervals from draws, or from standard errors alone.
draw
    `draw`: all of it; `ShadeDraws`, of which the simulation of the states needs to know.
of_metric
    `interval_of` any metric of E.
"""

from drcmitsuba.metrics.intervals.draw import ShadeDraws, draw
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.of_metric import interval_of
from drcmitsuba.metrics.intervals.rules import Rules, t_factor
from drcmitsuba.metrics.intervals.spread import Bounds, DrawnShares, Draws, values

__all__ = [
    "Bounds",
    "Closures",
    "DrawnShares",
    "Draws",
    "Rules",
    "ShadeDraws",
    "draw",
    "interval_of",
    "t_factor",
    "values",
]
