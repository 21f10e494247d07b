"""Radiance scene descriptions, views and sensors, read without Radiance.

read
    Scene files as a model.
read_views, read_points
    Views of a `.vf` file, sensors of a `.pts` file.
"""

from drcmitsuba.model.radiance.model import read
from drcmitsuba.model.radiance.views import read_points, read_views

__all__ = ["read", "read_points", "read_views"]
