"""Components as geometry: the surfaces of a case's components, and the ports they get light by.

place
    All components of a case where they stand.
"""

from drcmitsuba.components.place import check_ports, inside, place
from drcmitsuba.components.placed import Placed

__all__ = ["Placed", "check_ports", "inside", "place"]
