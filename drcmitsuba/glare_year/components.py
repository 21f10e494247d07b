"""Connected components of graphs with many nodes, on the device."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.symbolic import symbolic


def components(nodes: int, one: mi.UInt32, two: mi.UInt32) -> mi.UInt32:
    """Least node of the component of every node.

    In each round the larger root at an edge takes the smaller one; edges within a component are
    dropped.

    Parameters
    ----------
    nodes : int
        Number of nodes.
    one, two : mi.UInt32, shape (edge,)
        Nodes that edges join.

    Returns
    -------
    mi.UInt32, shape (node,)
    """
    root = dr.arange(mi.UInt32, nodes)
    dr.eval(root)
    while True:
        ends = dr.gather(mi.UInt32, root, one), dr.gather(mi.UInt32, root, two)
        apart = dr.compress(ends[0] != ends[1])
        if not dr.width(apart):
            return root
        one, two = (dr.gather(mi.UInt32, end, apart) for end in ends)
        forest = mi.UInt32(root)
        dr.eval(forest, one, two)
        dr.scatter_reduce(dr.ReduceOp.Min, forest, dr.minimum(one, two), dr.maximum(one, two))
        root = followed(forest)
        dr.eval(root)


@symbolic
def followed(forest: mi.UInt32) -> mi.UInt32:
    """Root of every node of a forest, in which each node names one before it, and a root itself."""
    root = dr.gather(mi.UInt32, forest, dr.arange(mi.UInt32, dr.width(forest)))
    up = dr.gather(mi.UInt32, forest, root)
    while dr.hint(up != root, exclude=[forest]):
        root = up
        up = dr.gather(mi.UInt32, forest, root)
    return root
