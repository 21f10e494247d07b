"""Rays of eyes: what they end at, for pictures and for glare alike.

paths
    `EyePaths` follows rays to their ends.
ends
    Ends by their kind, on the device and in memory.
optics
    What surfaces reflect diffusely, and how they turn rays.
mirrored_sun
    How mirrors show the sun: by exact images, by their lobe, or by chance.
openings
    Openings that rays meet.
"""
