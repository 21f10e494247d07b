"""Buildings in gbXML: spaces, surfaces with their openings, shades, place.

entries
    Elements of a file, whose values are checked where they are read.
materials
    Glass by its visible transmittance.
surfaces
    Surfaces with their openings cut out, as layers.
gaps
    Gaps between the surfaces of a space, and what closes them.
spaces
    Spaces with their names, uses and storeys.
reader
    `read`: a file as a model.
"""

from drcmitsuba.model.gbxml.reader import is_gbxml, read

__all__ = ["is_gbxml", "read"]
