"""HBJSON models of Honeybee.

reader
    `read`: from a file to a model.
entries
    JSON objects whose values are checked where they are read.
overlap
    What two touching faces share, and what each has alone.
spaces
    Rooms as spaces: name, program, storey, floor.
pieces, layers
    Polygons of rooms and shades, once each, and the layers that they make.
modifiers, modifier_materials
    Which modifier an object has, and its material.
bsdf_files
    `bsdf_xml`: BSDF files that a model holds.
points_and_views
    Its sensor grids and views.
"""

from drcmitsuba.model.honeybee.bsdf_files import bsdf_xml
from drcmitsuba.model.honeybee.reader import read

__all__ = ["bsdf_xml", "read"]
