"""Light as matrices: what receivers get of every bin, and products with what sees it.

lit_cells
    Cells that get light, and bins that send it: products leave out all others.
products
    Products of what rays gather and the light of cells, in several replicates at once.
irradiance
    D of receivers by sky and by suns.
"""
