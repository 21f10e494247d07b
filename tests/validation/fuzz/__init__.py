"""Random rooms and buildings beside the path tracer, to find what nobody thought of testing.

`boxes` and `buildings` draw cases, `agreement` compares the light of the ground, the sky and wide
suns on their sensors with that of the plugin `coefficient`, which shares no path, no cell and no
sum with them. A seed draws the same case anywhere: what one run reports another can repeat.
"""
