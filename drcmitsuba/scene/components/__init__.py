"""Components as geometry: their surfaces, and the ports by which light reaches them.

place
    All components of a case, in position and checked.
inside
    Whether points lie in closed meshes.
"""

from drcmitsuba.scene.components.placed_component import PlacedComponent
from drcmitsuba.scene.components.placement import inside, place

__all__ = ["PlacedComponent", "inside", "place"]
