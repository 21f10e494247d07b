"""Components as geometry: the surfaces of a case's components, and the ports they get light by.

place
    All components of a case where they stand, checked.
inside
    Which points lie in a closed mesh.
"""

from drcmitsuba.scene.components.place import inside, place
from drcmitsuba.scene.components.placed import Placed

__all__ = ["Placed", "inside", "place"]
