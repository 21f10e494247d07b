"""Sizes of launches: large enough to fill a GPU, small enough for memory, whatever a case asks."""

SENSORS = 1 << 10
"""Largest number of sensors whose paths are gathered in one launch."""
PATHS = 1 << 21
"""Number of paths in one launch; the paths of a sensor stay in one launch."""
PHOTONS = 1 << 21
"""Number of photons in one launch; the photons of a source stay in one launch."""
SHADOW_RAYS = 1 << 23
"""Number of shadow rays, or of look-ups in a film, in one launch."""
