"""Connected components on the device against those of SciPy."""

import mitsuba as mi
import numpy as np
import pytest
from scipy import sparse
from scipy.sparse import csgraph

from drcmitsuba.glare_year.components import components
from drcmitsuba.runtime import backend


@pytest.mark.parametrize(("nodes", "edges"), [(5, 0), (2000, 900), (2000, 3000)])
def test_components_are_those_of_scipy(nodes, edges):
    backend.select()
    one, two = np.random.default_rng(edges).integers(0, nodes, (2, edges))
    label = components(nodes, *(mi.UInt32(end.astype(np.uint32)) for end in (one, two))).numpy()
    graph = sparse.coo_array((np.ones(edges), (one, two)), shape=(nodes, nodes))
    theirs = csgraph.connected_components(graph, directed=False)[1]
    least = np.full(theirs.max() + 1, nodes)
    np.minimum.at(least, theirs, np.arange(nodes))
    np.testing.assert_array_equal(label, least[theirs])


def test_a_long_chain_in_any_order_is_one_component():
    backend.select()
    order = np.random.default_rng(1).permutation(5000).astype(np.uint32)
    label = components(5000, mi.UInt32(order[:-1]), mi.UInt32(order[1:])).numpy()
    assert (label == 0).all()
