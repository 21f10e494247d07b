"""Scene: geometry and materials of a case, as the Mitsuba scenes that transport traces.

materials
    Materials of a case as Mitsuba BSDFs.
structures
    Micro-structures from recipe files and meshes.
geometry, coplanar
    The room as quadrilaterals; faces that share a plane.
components
    Components that are geometry: structures in strips, light pipes, ducts, meshes.
pane_groups, panes_in_state
    Panes that change their state together; what they are in a state of the façade.
fills, tiled_facades, shared_facades
    Openings and what may stand in them; façades cut into tiles; what variants have in common.
sun_visibility, enabled_effects
    Suns that can get in; effects that are simulated.
exits
    Rectangles that straight light passes on its way out of the rooms of a model.
leaks, daylit
    Rooms of a model that are open to the sky, and those that no daylight enters.
surfaces, sensors
    All surfaces of a case as plain geometry; points at which illuminance is computed.
prepared_case
    Groups of panes and sensors of a case, found once, from which all rooms read.
flat_panes, box_faces
    Clear panes and walls that rays meet in closed form.
mitsuba_scenes
    Mitsuba scenes that one kernel may trace together.
scene
    The same surfaces as Mitsuba scenes.
"""
