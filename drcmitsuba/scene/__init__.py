"""Scene: geometry and materials of a case, as the Mitsuba scenes that transport traces.

materials
    Materials of a case as Mitsuba BSDFs.
structures
    Micro-structures from recipe files and meshes.
geometry, coplanar
    The room as quadrilaterals; faces that share a plane.
components
    Components that are geometry: structures in strips, light pipes, ducts, meshes.
panes_of_model, like_panes
    Panes of a model, and which side faces the room; panes of one material and direction.
pane_groups, panes_in_state
    Panes that change their state together; what they are in a state of the façade.
facade_rectangles, upright_planes, tiled_walls, outer_faces
    Where the fill of a wall may change: façades, planes and walls of a model, their outer faces.
fills, tiled_facades, shared_facades
    Openings and what may stand in them; façades cut into tiles; what variants have in common.
sun_visibility, enabled_effects
    Suns that can get in; effects that are simulated.
exits
    Rectangles that straight light passes on its way out of the rooms of a model.
floors_of_model, spaces, space_walls, wall_sides
    Floors and rooms of a model; spaces by name, their walls, and what lies on either side.
leaks, daylit, panes_behind
    Rooms of a model that are open to the sky, those that no daylight enters, panes close behind
    one another.
surfaces, sensors, sensors_of_model, nearest_sensors, views
    All surfaces of a case as plain geometry; points at which illuminance is computed; eyes.
prepared_case
    Groups of panes and sensors of a case, found once, from which all rooms read.
flat_panes, box_faces
    Clear panes and walls that rays meet in closed form.
meshes, mitsuba_scenes, met_faces
    Meshes that Mitsuba traces; Mitsuba scenes that one kernel may trace together; their faces where
    rays meet them.
scene
    The same surfaces as Mitsuba scenes.
"""
