"""Blocks: coefficients on disk by what they depend on, so that no run computes them twice.

block_file
    One block: a zarr folder in a ZIP archive, whose checksums find damage.
part
    Every n-th block: the share of a worker.
stored_before
    Blocks that were stored before a run began, of which it tells.
block_folder
    Blocks of a run, or of many runs that share a cache.
"""
