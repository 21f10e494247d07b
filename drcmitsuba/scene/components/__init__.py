"""Components as geometry: the surfaces of a case's components, and the ports they get light by.

place
    All components of a case where they stand, checked.
inside
    Which points lie in a closed mesh.
"""

from drcmitsuba.scene.components.placed_component import PlacedComponent
from drcmitsuba.scene.components.placement import inside, place

__all__ = ["PlacedComponent", "inside", "place"]
