"""Rays: straight light from sky and suns, through openings and clear panes.

bsdf_lookup
    Properties of surfaces by the number of their BSDF; absorption along paths in solids.
openings
    Openings of a room, and which directions from which points may leave it by them.
first_hit
    First surface that a ray meets, in a box room without a search among its walls.
even_rays
    Directions spread evenly by the cosine law, those alone that may leave by an opening.
sun_clusters
    Neighbouring suns, and which points may see which of them.
shadow_rays
    D by shadow rays to sky and suns.
straight_suns
    D and C by suns alone, with more directions where a shadow's edge crosses their disks.
"""
