"""Panes that scatter evenly: light of one of them, or of several in turn.

patches
    Parallelograms and triangles that panes are cut into.
acceptance
    Share of the light on outer faces that counts, by its incidence.
transfer
    Directions from receivers to panes; K from the faces of panes to receivers and to each other.
"""
