"""Buildings in IFC 2x3 and 4, by ifcopenshell (`pip install drcmitsuba[ifc]`).

shapes
    Shapes of the elements as triangles, by material.
panes
    Solid panes of glass as sheets.
spaces
    Spaces with their names, uses and storeys.
reader
    `read`: a file as a model.
"""

from drcmitsuba.model.ifc.reader import read

__all__ = ["read"]
