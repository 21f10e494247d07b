"""Models that users own, read as surfaces with materials, sensors, views and a place.

materials
    Panes, mirrors, solids, diffuse surfaces.
model
    What every reader gives.
group_states
    States of a model's groups, and models that stay in one of them.
space
    Rooms by name, with their floors.
glass, translucent
    Panes by Fresnel's formulas; panes with a lobe around the straight direction.
shared_walls
    Faces that lie in one place, of two rooms: one sheet with a side for each.
windows, window_table
    New windows that are cut out of walls, and the table that lists them.
written_files
    Files that a reading writes for the length of the process.
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
