"""Mirrors: light that planar mirrors turn before it meets anything that scatters.

mirror_planes
    Planes of mirrors, their axes, and chains of those that face each other.
planar_mirrors
    Surfaces in which suns have images, and the turns that these take.
image_suns
    D by smooth mirrors: images of the suns by exact geometry, and the mirrored sky.
sun_lobes
    D by rough mirrors in few planes: lobes of the suns, and the sky.
"""
