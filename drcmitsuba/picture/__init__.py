"""Pictures: files, views, glare, and how they look on a screen.

picture
    `Picture`: radiance of the pixels in units of luminance, with view.
view, projection
    `PictureView`: directions of pixels and the solid angles that they cover.
files
    `read`, `save`: Radiance (`.hdr`) and OpenEXR (`.exr`).
hdr, hdr_header, rgbe
    Radiance's pictures.
exr, exr_header
    OpenEXR pictures.
tone, screen, false_colour
    Pictures for a screen: by exposure, as the eye would see them, in colours with a legend.
    `Screen`: its space, sRGB or Display P3, and what is white.
glare, glare_sources, position_index
    `glare`: DGP, UGR and DGI of a picture from its glare sources.
"""

from drcmitsuba.picture.files import read, save
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.view import PictureView

__all__ = ["Picture", "PictureView", "read", "save"]
