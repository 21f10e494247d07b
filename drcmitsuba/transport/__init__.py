"""Transport of light from sources to sensors: C = D(sensors) + G·D(cells).

Folders import only folders above them, and nothing of what joins them, which stands beside them:

rays
    D: light that comes straight, through openings and clear panes.
light
    D as matrices, and products.
mirrors
    D: light that planar mirrors turn.
panes
    D: light that panes scatter evenly.
films
    D: light that one measured pane sends on.
cells
    Patches of diffuse surface between gather and deposit; points that stand for them.
gather
    G: paths from the sensors to the diffuse surfaces; G·D.
interreflection
    H = D + T·H: light between surfaces, solved on cells; G₁·H.
photons
    D: light by every other chain, from film to film and by components.

These modules join them:

deposit, pane_light
    D: all of it but photons; light of scattering panes in several replicates.
replicate, coefficient_arrays, shared_paths, coefficients
    C with the standard error of every entry; what the states of a façade share of it.
block_content
    What the coefficients of some rooms depend on, however others have changed.
own_exits
    Panes and holes that light passes last on its way to each room of a building.
sun_interpolation
    C of suns between the suns of a mesh.

These folders ask for them:

windows
    D and C by the window that light comes in by; how far points see out.
elements
    Light by opening and fill: any façade, hour by hour, from one simulation.
"""
