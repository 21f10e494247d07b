"""Photons: light by every chain that no other estimator counts, by films and by components.

changing_panes
    Panes that the states of a façade may change.
surfaces
    Surfaces as photons meet them.
pane_ports
    Sides of panes on which photons start.
ports
    Ports of components, and the suns, sky and ground that light them.
starts
    Photons that start on the ports of several components.
reached
    Parts of surfaces that the sensors' paths reach.
receivers
    Areas that photons are counted on: cells, and squares around sensors.
fluxes
    Sums of flux on these, and by fate.
paths
    Paths of photons from surface to surface.
light
    D of cells and sensors by photons, and the ledger of their flux.
tracer
    All photons of a replicate.
"""
