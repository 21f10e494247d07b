"""A year of glare: DGP of every view at every time stamp, without pictures.

year
    `glare`: from a case to a `GlareYear`.
rule
    Threshold of glare sources, and constants of DGP.
eyes
    Places of eyes, and their lines of sight.
pixels
    Rays round an eye.
chains
    What rays meet, through panes and by way of mirrors.
films, suns
    Glow of films; images of the suns.
seen
    Luminances of what is seen from a place.
tiles, components, sources
    Rays near each other; graphs; glare sources of every hour.
forecast
    Time that a year takes.
state, eye_samples
    One state of the façade over the year; what reaches the eyes in it, averaged over rounds.
rounds
    Further samples until the target of the case.
result
    `GlareYear`: shares of the hours, classes of EN 17037, files and pictures.
"""

from __future__ import annotations

from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.year import glare

__all__ = ["GlareYear", "Rule", "glare"]
