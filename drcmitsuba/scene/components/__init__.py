"""Components as geometry: their surfaces, and the ports by which light reaches them.

placed_component
    Component in the room: its surfaces, its ports, and its hole in the ceiling.
lightpipe, duct, structure, mesh, of_model
    Straight pipes, ducts with an anidolic entry, structures in strips, meshes, mirrors and solids
    of a model.
placement
    `place`: all components of a case, checked; `inside`: whether points lie in closed meshes.
"""

from drcmitsuba.scene.components.placed_component import PlacedComponent
from drcmitsuba.scene.components.placement import inside, place

__all__ = ["PlacedComponent", "inside", "place"]
