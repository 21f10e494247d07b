"""Connected components of graphs with many nodes, on the device."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def components(nodes: int, one: mi.UInt32, two: mi.UInt32) -> mi.UInt32:
    """Least node of the component of every node.

    In each round the larger label at an edge takes the smaller one; edges within a component are
    dropped. Labels are then followed until each node has that of its root.

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
    label = dr.arange(mi.UInt32, nodes)
    dr.eval(label)
    while True:
        ends = dr.gather(mi.UInt32, label, one), dr.gather(mi.UInt32, label, two)
        apart = dr.compress(ends[0] != ends[1])
        if not dr.width(apart):
            return label
        one, two = (dr.gather(mi.UInt32, end, apart) for end in ends)
        hooked = mi.UInt32(label)
        dr.eval(hooked, one, two)
        dr.scatter_reduce(dr.ReduceOp.Min, hooked, dr.minimum(one, two), dr.maximum(one, two))
        dr.eval(hooked)
        while not dr.all(hooked == label):
            label, hooked = hooked, dr.gather(mi.UInt32, hooked, hooked)
            dr.eval(hooked)
