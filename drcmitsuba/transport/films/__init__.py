"""Films: light that a pane with a measured BSDF scatters once.

orientation
    How films are mounted, and the sides that light and receivers reach.
looks
    Directions from receivers to films, and their weights by outgoing cell.
answers
    Radiance that films send on, of suns and of the sky.
sums
    Sums of answers over the directions of a receiver.
peaks
    Sunlight by narrow peaks that other surfaces shade.
films
    All films of a scene: what receivers get from them.
"""
