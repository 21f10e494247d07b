"""Windows: light told apart by the window that it comes in by.

deposit
    D by window.
light_paths
    C of a few sensors by window and number of bounces.
view_rays
    How far points see beyond clear openings.
"""
