"""A year of glare: DGP of every view at every time stamp, without pictures.

year
    `glare`: from a case to a `GlareYear`.
glare_by_element
    `glare_elements`: what is seen, and the light at eyes, by opening and fill; any façade from it.
rule
    Threshold of glare sources, and constants of DGP.
eyes
    Places of eyes, and their lines of sight.
pixels
    Rays round an eye.
seen_ends
    What rays of an eye end at, as glare counts it.
films, suns
    Glow of films; images of the suns.
worst_views, state_doubts
    The most dazzled view of every space, and areas; doubts about the state in intervals of hours.
seen, surface_light, luminance_noise
    What is seen from a place by every element; luminances of surfaces by the light of each, and
    their noise.
luminances
    Luminances of what is seen from a place in a façade.
tiles, bright_tiles, components, sources
    Rays near each other, and those that are bright; graphs; glare sources of every hour.
place
    Sums over the glare sources of a place.
forecast
    Time that a year takes.
by_element, state
    Light at eyes and of surfaces by element, and in one state of the façade.
facades
    Shares of fills by the hour: states of the case, and choices.
eye_samples, element_sampler
    What reaches the eyes in a façade; averages over rounds.
rounds
    Further samples until the target of the case.
joined_sources, searched_eyes
    Sources of a searched façade that join; DGP as a function of shares of fills, with derivatives,
    for searches.
result
    `GlareYear`: shares of the hours, classes of EN 17037, files and pictures.
"""

from __future__ import annotations

from drcmitsuba.glare_year.glare_by_element import GlareElements, glare_elements
from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.searched_eyes import EyesOfSearch
from drcmitsuba.glare_year.year import glare

__all__ = ["EyesOfSearch", "GlareElements", "GlareYear", "Rule", "glare", "glare_elements"]
