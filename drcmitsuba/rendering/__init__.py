"""Rendering: pictures of the views of a case, in cd/m², at any hour from one set of light paths.

view_rays
    Rays of the pixels, which `eye` follows to the first diffuse surface.
sky_rays, glow
    Light of the sky and of scattering panes on these surfaces.
surface_light
    Light on all surfaces of the scene, of which the rays gather.
pane_light, caustics
    Light that components throw on panes, and on surfaces.
facade_scenes, eye_by_element, pixel_paths, light_paths
    All of a picture that depends neither on the hour nor on the state of the façade, by element.
asked_view
    Of which façade and in which parts a view is asked for, and where its light paths are kept.
view_by_element, chosen_paths, view_glow, traced_view
    The same in a state, as a sum.
outside, sun_on_surfaces, hour
    Sky, ground and sun of an hour, and the picture that they give.
view_colours
    Colour of that picture, from few light paths in each band.
coefficient_pictures
    Pictures of each sky bin.
view_parts, stored_view
    A view traced in every channel and band; light paths on disk.
view_of_case, view_facade
    Views of a case; its openings, and their fills in a state or by a choice.
rendering, prepared_view
    `prepare`: pictures with their standard error, and their files.
rounds
    Further rounds of rays, averaged until a picture is as sure as wanted.
frames
    `render`, `frames`: pictures at instants, whose façade may follow the control of the case.
"""

from drcmitsuba.rendering.frames import frames, render
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.prepared_view import PreparedView, prepare
from drcmitsuba.rendering.rendering import Rendering

__all__ = ["PreparedView", "Rendering", "Sampling", "frames", "prepare", "render"]
