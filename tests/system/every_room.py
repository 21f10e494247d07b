"""Rooms of every kind that verbs are tried on: boxes, and models of two rooms."""

from tests.unit.model import box_room as box

COMMON = """
[period]
months = [3]
days_per_week = 1
[materials.opal]
type = "diffuser"
transmittance = 0.5
[materials.shade]
type = "diffuser"
transmittance = 0.1
[accuracy]
replicates = 2
paths = 16
[views.desk]
position = [2.0, 2.0, 1.2]
direction = [0.0, -1.0, 0.0]
"""
GLASS = '[materials.glass]\ntype = "glazing"\ntransmittance = 0.65\n'
ROOM = COMMON + GLASS + "[room]\nsize = [4.0, 5.0, 3.0]\n{room}\n"
SENSORS = "[sensors]\ncorner = [0.5, 0.5, 0.8]\ncount = [3, 3]\nspacing = 1.2\n"
SHADING = '[shading]\nmaterial = "shade"\n'
SOUTH = '[facade.south]\nstrips = [{ bottom = 0.9, top = 2.4, material = "glass" }]\n'
WEST = SOUTH.replace("south", "west")
FILM = """[facade.south]
strips = [{ bottom = 0.9, top = 1.8, material = "glass" },
          { bottom = 1.8, top = 2.4, material = "opal" }]
"""
GROUPS = """[groups.south]
panes = ["glass"]
facing = "south"
states = ["opal", "shade"]
[groups.west]
panes = ["glass"]
facing = "west"
states = ["shade"]
"""
PIPE = """[materials.silver]
type = "mirror"
reflectance = 0.95
[components.pipe]
type = "lightpipe"
centre = [2.0, 3.5]
width = 0.4
height = 1.0
mirror = "silver"
"""
PLAIN = ROOM.format(room="") + SENSORS
BOXES = {
    "box": PLAIN + SHADING + SOUTH,
    "two sides": PLAIN + SHADING + SOUTH + WEST,
    "film beside glass": PLAIN + SHADING + FILM,
    "groups": PLAIN + SOUTH + WEST + GROUPS,
    "component": PLAIN + SHADING + SOUTH + PIPE,
    "groups and component": PLAIN + SOUTH + WEST + GROUPS + PIPE,
    "coloured": ROOM.format(room="floor = [0.4, 0.2, 0.1]") + SENSORS + SHADING + SOUTH,
}


FLOORS = '[sensors]\nfloors = ["{floor}"]\nspacing = 1.4\n'
OF_MODEL = COMMON + '[model]\nfiles = ["{file}"]\n' + FLOORS
BLINDS = """[groups.first]
panes = ["pane_1"]
states = ["opal", "shade"]
[groups.second]
panes = ["pane_2"]
states = ["shade"]
"""
PANES = "".join(f'[materials.pane_{k}]\ntype = "glazing"\ntransmittance = 0.6\n' for k in (1, 2))
RADIANCE = OF_MODEL.format(file="rooms.rad", floor="floor")
MESH = RADIANCE.replace("rooms.rad", "rooms.obj").replace(
    "[sensors]",
    'unit = "m"\n[model.reflectances]\nwall = 0.5\nfloor = 0.2\nceiling = 0.8\n[sensors]',
)
HONEYBEE = OF_MODEL.format(file="rooms.hbjson", floor="generic_floor_0.20")
MODELS = {
    "Radiance model with groups": RADIANCE + PANES + BLINDS,
    "mesh": MESH + PANES + SHADING,
    "Honeybee model": HONEYBEE + GLASS + SHADING,
}
SHIFT = 5.0
"""Distance of the models' two rooms [m]."""


def of_another_pane(text):
    """Case whose first pane is lower, or of a model whose panes are milky."""
    if "top = 2.4" in text:
        return text.replace("top = 2.4", "top = 2.0", 1)
    milky = '[materials.{}]\ntype = "diffuser"\ntransmittance = 0.5\n'
    pane = '[materials.pane_2]\ntype = "glazing"\ntransmittance = 0.6\n'
    if pane in text:
        return text.replace(pane, milky.format("pane_2"))
    return text + milky.format('"generic_exterior_window_vis_0.64"')


def write_models(folder):
    """Write two rooms side by side as a Radiance scene, as a mesh and as a Honeybee model."""
    vertices, faces, scene = [], [], []
    for name, grey in (("wall", 0.5), ("floor", 0.2), ("ceiling", 0.8)):
        scene.append(f"void plastic {name} 0 0 5 {grey} {grey} {grey} 0 0")
    for k in (1, 2):
        scene.append(f"void glass pane_{k} 0 0 3 .65 .65 .65")
        corners = box.VERTICES + [SHIFT * (k - 1), 0, 0]
        for i, (name, index) in enumerate(box.OBJ):
            own = f"pane_{k}" if name == "pane" else name
            numbers = " ".join(str(len(vertices) + j + 1) for j in index)
            faces += [f"usemtl {own}", f"f {numbers}"]
            points = " ".join(f"{v:g}" for v in corners[index[::-1]].ravel())
            scene.append(f"{own} polygon p{k}_{i} 0 0 12 {points}")
        vertices += corners.tolist()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices]
    (folder / "rooms.obj").write_text("\n".join([*lines, *faces]) + "\n")
    (folder / "rooms.rad").write_text("\n".join(scene) + "\n")
    rooms = box.room("Room_1"), box.room("Room_2", shift=SHIFT)
    box.written(folder, box.model(*rooms), "rooms.hbjson")
