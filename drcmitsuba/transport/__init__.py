"""Transport of light from sources to sensors: C = D(sensors) + G·D(cells).

bsdf_lookup, film_orientation
    Properties of surfaces by BSDF number; orientation of films.
launch_size
    Numbers of sensors, paths, photons and shadow rays in one launch.
cells, cell_points
    Patches of diffuse surface between gather and deposit; points that stand for them.
first_hit
    First surface that a ray meets, in a box room without a search among its walls.
gather, gather_blocks
    G: paths from the sensors to the diffuse surfaces, in blocks that fit in memory; G·D.
openings, sun_clusters, shadow_rays
    D: light that comes straight, through openings and clear panes.
diffusing_panes, film_looks, film_answers, film_sums, films, film_peaks
    D: light that one scattering pane sends on, evenly, by a measured BSDF, by its narrow peaks.
ports, photon_paths, receivers, photons
    D: light by every other chain, from film to film and by components, on photons.
deposit
    D: all of it.
cell_rays, solved_cells
    H = D + T·H: light between surfaces, solved on cells.
first_bounce
    G₁·H where cells are many.
straight_suns
    D and C of straight light from suns: where a shadow's edge crosses their disks.
replicate, coefficient_arrays, sensor_blocks, coefficients
    C with the standard error of every entry.
window_deposit, light_paths
    D by the window that light comes in by; C by window and number of bounces.
view_rays
    How far points see beyond clear openings.
sun_interpolation
    C of suns between the suns of a mesh.
facade_basis
    C by façade tile and material: any composition from one simulation.
"""
