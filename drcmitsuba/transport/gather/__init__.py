"""Gather G: paths from the sensors backward through the room to diffuse surfaces.

paths
    Paths of one launch, with the marks of what they met.
blocks
    Paths of any number of sensors, in blocks that fit in memory.
"""
