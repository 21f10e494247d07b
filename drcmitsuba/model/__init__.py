"""Models that users own, read as surfaces with materials, sensors, views and a place.

materials
    Panes, mirrors, solids, diffuse surfaces.
model
    What every reader gives.
space
    Rooms by name, with their floors.
polygon
    Polygons of any shape, with holes, as triangles and parallelograms.
plane
    Shapes in a plane, cut by shapely.
radiance
    Radiance scene descriptions, views and sensors.
facets
    Many polygons of few corners at once; triangles joined to parallelograms.
source_file, notes
    Files from strangers, of bounded size; sentences about what a reader simplified.
radiance_materials
    Materials of Radiance as those of the engine.
honeybee
    `read`: HBJSON models of Honeybee.
unstated
    Materials that building models do not state.
gbxml
    `read`: buildings in gbXML.
ifc
    `read`: buildings in IFC.
mesh
    `read`: OBJ, PLY, STL, glTF and GLB files.
mitsuba
    `read`, `from_dict`: Mitsuba scenes, XML or dictionaries.
"""
