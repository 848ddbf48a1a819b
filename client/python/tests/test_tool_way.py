import numpy as np
import pytest

import kerf
from kerf.tool_way import ToolWay

HOLDING, LIFTED = kerf.ContactFlags.HOLDING, kerf.ContactFlags.LIFTED

LEVEL = (0.0, 0.0, 0.0, 1.0)


def depths_m(way, positions_m, flags, forces_n, orientation=LEVEL):
    """Of one tool that is told where to be in each step."""
    inputs = [{0: None if at is None else kerf.Placement(np.array([*at, *orientation]))} for at in positions_m]
    force_n = np.zeros((len(flags), 1, 3))
    force_n[:, 0, 1] = forces_n
    return way.take(inputs, np.array(flags, dtype=np.uint32)[:, None], force_n)[1][:, 0]


def test_an_edge_is_as_deep_as_it_has_gone_the_way_it_cuts():
    heights_m = [0.02, 0.01, 0.008, 0.004, 0.009, 0.012]
    deep_m = depths_m(ToolWay(1), [(0, y, 0) for y in heights_m], [0] * 6, [0, 1, 1, 1, 1, 0])
    np.testing.assert_allclose(deep_m, [0, 0, 0.002, 0.006, 0.001, 0])


def test_jaws_that_hold_are_as_deep_as_they_have_pulled_whichever_way():
    way = ToolWay(1)
    # Pushed down on it, closed, then pulled up and aside: by 3, then 5 mm.
    down = depths_m(way, [(0, 0.0, 0), (0, -0.002, 0)], [0, 0], [1, 1])
    np.testing.assert_allclose(down, [0, 0.002])
    held = [(0, -0.002, 0), (0, 0.001, 0), (0.004, 0.001, 0)]
    np.testing.assert_allclose(depths_m(way, held[:1], [HOLDING], [1]), [0])
    # The hold lasts from one call to the next, and without a force.
    np.testing.assert_allclose(depths_m(way, held[1:], [HOLDING] * 2, [0, -2]), [0.003, 0.005])
    # It lets go above where it touched: in the air.
    assert depths_m(way, held[-1:], [0], [0]) == 0
    assert depths_m(way, [(0, -0.05, 0)], [HOLDING], [1]) == 0


@pytest.mark.parametrize("ends", ["lifts", "is forgotten"])
def test_a_hold_ends_where_the_tool_is_gone(ends):
    way = ToolWay(1)
    assert depths_m(way, [(0, 0, 0), (0, 0.01, 0)], [HOLDING] * 2, [1, 1])[-1] == pytest.approx(0.01)
    if ends == "lifts":
        assert depths_m(way, [None], [LIFTED], [0]) == 0
    else:
        way.forget()
    np.testing.assert_allclose(depths_m(way, [(0, 0.03, 0), (0, 0.031, 0)], [HOLDING] * 2, [1, 1]), [0, 0.001])
