"""Models that users own, read as surfaces with materials, sensors, views and a place.

materials
    Panes, mirrors, solids, diffuse surfaces.
model
    What every reader gives.
polygon
    Polygons of any shape, with holes, as triangles and parallelograms.
radiance
    Radiance scene descriptions, views and sensors.
"""
