"""Light from sources to sensors: C = D(sensors) + G·D(cells).

gather
    G: paths from the sensors to the diffuse surfaces.
cells
    The patches of surface between gather and deposit.
shadow_rays
    D: light that comes straight, through openings and clear panes.
panes
    D: light that panes scatter.
deposit
    D: both together.
"""
