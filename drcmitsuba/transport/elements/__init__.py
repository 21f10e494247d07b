"""Light by element: what comes in by every opening with every fill, and any façade from it.

marks, marked_light
    Marks of paths that met openings whose fill is left open; the light of such paths.
weights
    Shares of elements at every time stamp, and the sums of their light.
paths, solved_paths
    Paths that met no opening, and what openings send back: of all bounces, or solved on cells.
mirrored_pairs, mirrored_deposit, mirrored_looks
    Pairs of elements, of which one mirrors the light of the other; their light, and directions by
    way of mirrors to panes that scatter.
scenes
    Scenes in which one opening with one fill lets light in, and their deposits.
light_on_receivers
    Light on sensors and cells, and what paths gather of it: without dark cells, by parts of panes.
trace
    Paths of a case, and the light of every element before any diffuse reflection.
straight_light, straight_pairs
    Light that comes straight, of the pairs of a bin and a sensor that see each other; of all
    elements, by any shares.
light, simulate
    Coefficients of every element, of which any façade is recombined.
light_of_surfaces
    Light by element for each set of the surfaces that fills bring, made when asked for.
illuminance
    A year of known shares, of which no coefficients are kept.
known_year, year_by_bin
    Illuminances of a year by element; those of few façades, each from its own coefficients.
state_illuminances, mixed_rows, smooth_return, smooth_year, smooth_states
    E of a period in every state of a façade; weighted sums of arrays; what openings send
    back, and the smooth twin of a year of known light, whose derivatives by the shares are exact;
    twins of states that bring surfaces of their own.
"""

from drcmitsuba.transport.elements.illuminance import illuminance
from drcmitsuba.transport.elements.light import ElementLight, LightByElement
from drcmitsuba.transport.elements.simulate import compute, memory
from drcmitsuba.transport.elements.weights import Year, chosen

__all__ = ["ElementLight", "LightByElement", "Year", "chosen", "compute", "illuminance", "memory"]
