"""A small building in IFC, made by ifcopenshell: two rooms with a window and a glazed door."""

import os
import signal

import ifcopenshell
import ifcopenshell.api
import numpy as np

BOX = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
"""Faces of a box's corners, counter-clockwise from outside."""


def api(usecase, model, **arguments):
    return ifcopenshell.api.run(usecase, model, **arguments)


def box(low, high):
    """Corners (8, 3) and faces of a box."""
    (x, y, z), (u, v, w) = low, high
    corners = [
        (x, y, z),
        (u, y, z),
        (u, v, z),
        (x, v, z),
        (x, y, w),
        (u, y, w),
        (u, v, w),
        (x, v, w),
    ]
    return np.array(corners, float), BOX


def ring(low, high, width):
    """Corners (16, 3) and faces of a box without what is farther than `width` from its sides."""
    inset = np.array([width, width, 0])
    corners = [box(low, high)[0], box(low + inset, high - inset)[0]]
    faces = []
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 0)):
        faces += [(i, j, j + 4, i + 4), (j + 8, i + 8, i + 12, j + 12)]
        faces += [(j, i, i + 8, j + 8), (i + 4, j + 4, j + 12, i + 12)]
    return np.concatenate(corners), faces


def joined(*boxes):
    """Corners and faces of several boxes."""
    corners, faces = [], []
    for own, its in boxes:
        faces += [tuple(i + sum(map(len, corners)) for i in face) for face in its]
        corners.append(own)
    return np.concatenate(corners), faces


class IfcBuilding:
    """File that grows by elements of boxes [m], in any unit of length."""

    def __init__(self, schema="IFC4", millimetres=False):
        self.model = ifcopenshell.file(schema=schema)
        if schema == "IFC2X3":  # every entity has an owner
            who = {
                "person": api("owner.add_person", self.model),
                "organisation": api("owner.add_organisation", self.model),
            }
            api("owner.add_person_and_organisation", self.model, **who)
            api("owner.add_application", self.model)
        self.project = api("root.create_entity", self.model, ifc_class="IfcProject", name="p")
        prefix = {"prefix": "MILLI"} if millimetres else {}
        unit = api("unit.add_si_unit", self.model, unit_type="LENGTHUNIT", **prefix)
        api("unit.assign_unit", self.model, units=[unit])
        self.whole = api("context.add_context", self.model, context_type="Model")
        self.body = api(
            "context.add_context", self.model, context_type="Model", context_identifier="Body",
            target_view="MODEL_VIEW", parent=self.whole,
        )  # fmt: skip
        self.site = self._part("IfcSite", "site", self.project)
        self.storeys = {
            name: self._part("IfcBuildingStorey", name, self.site) for name in ("Ground", "First")
        }

    def _part(self, kind, name, whole):
        part = api("root.create_entity", self.model, ifc_class=kind, name=name)
        api("aggregate.assign_object", self.model, products=[part], relating_object=whole)
        return part

    def add(self, kind, name, shape, clear=None, storey="Ground"):
        """Add an element of boxes, and further ones of a transparent material."""
        if kind == "IfcSpace":
            element = self._part(kind, name, self.storeys[storey])
        else:
            element = api("root.create_entity", self.model, ifc_class=kind, name=name)
        items = [self._faces(*shape)]
        if clear is not None:
            items.append(self._faces(*clear))
            style = api("style.add_style", self.model, name="clear glass")
            colour = {"Name": None, "Red": 1.0, "Green": 1.0, "Blue": 1.0}
            look = {"SurfaceColour": colour, "Transparency": 0.8}
            shading = "IfcSurfaceStyleRendering"
            if self.model.schema == "IFC2X3":
                look["ReflectanceMethod"] = "NOTDEFINED"
            api(
                "style.add_surface_style", self.model, style=style, ifc_class=shading,
                attributes=look,
            )  # fmt: skip
            api("style.assign_item_style", self.model, item=items[1], style=style)
        shape = self.model.createIfcShapeRepresentation(self.body, "Body", "Brep", items)
        api("geometry.assign_representation", self.model, product=element, representation=shape)
        api("geometry.edit_object_placement", self.model, product=element)
        return element

    def _faces(self, corners, faces):
        scale = ifcopenshell.util.unit.calculate_unit_scale(self.model)
        points = [
            self.model.createIfcCartesianPoint([float(v) for v in p / scale]) for p in corners
        ]
        sides = [
            self.model.createIfcFace(
                [self.model.createIfcFaceOuterBound(
                    self.model.createIfcPolyLoop([points[i] for i in face]), True
                )]
            )
            for face in faces
        ]  # fmt: skip
        return self.model.createIfcFacetedBrep(self.model.createIfcClosedShell(sides))

    def written(self, folder):
        file = folder / "house.ifc"
        self.model.write(str(file))
        return file


def house(**settings):
    """Rooms of 4 m by 5 m and 3 m beside each other; walls of 0.2 m and slabs of 0.3 m around."""
    made = IfcBuilding(**settings)
    wall = "IfcWall"
    made.add("IfcSlab", "floor", box((-0.2, -0.2, -0.3), (8.4, 5.2, 0)))
    made.add("IfcSlab", "roof", box((-0.2, -0.2, 3), (8.4, 5.2, 3.3)))
    made.add(wall, "north", box((-0.2, 5, 0), (8.4, 5.2, 3)))
    made.add(wall, "west", box((-0.2, 0, 0), (0, 5, 3)))
    made.add(wall, "east", box((8.2, 0, 0), (8.4, 5, 3)))
    made.add(wall, "between", box((4, 0, 0), (4.2, 5, 3)))
    around = joined(
        box((-0.2, -0.2, 0), (1, 0, 3)), box((3, -0.2, 0), (8.4, 0, 3)),
        box((1, -0.2, 0), (3, 0, 1)), box((1, -0.2, 2), (3, 0, 3)),
    )  # fmt: skip
    made.add(wall, "south", around)
    frame = joined(
        box((1, -0.15, 1), (1.1, -0.05, 2)), box((2.9, -0.15, 1), (3, -0.05, 2)),
        box((1.1, -0.15, 1), (2.9, -0.05, 1.1)), box((1.1, -0.15, 1.9), (2.9, -0.05, 2)),
    )  # fmt: skip
    glass = joined(
        box((1.1, -0.12, 1.1), (2.9, -0.116, 1.9)), box((1.1, -0.1, 1.1), (2.9, -0.096, 1.9))
    )
    made.add("IfcWindow", "window", frame, clear=glass)
    made.add("IfcFurniture" if made.model.schema == "IFC4" else "IfcFurnishingElement", "desk",
             box((1, 2, 0.7), (2, 3, 0.75)))  # fmt: skip
    west = made.add("IfcSpace", "1", box((0, 0, 0), (4, 5, 3)))
    west.LongName = "Office"
    east = made.add("IfcSpace", "2", box((4.2, 0, 0), (8.2, 5, 3)), storey="First")
    east.LongName, east.ObjectType = "Store", "storage"
    return made


def ended(file):
    """Take a file as a library does that it brings down."""
    os.kill(os.getpid(), signal.SIGSEGV)
