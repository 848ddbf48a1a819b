import numpy as np
import pytest

import kerf
from kerf.motion import Track


def turned_about_y(angle_rad):
    return [0, np.sin(angle_rad / 2), 0, np.cos(angle_rad / 2)]


def test_a_tool_moves_evenly_and_turns_by_the_shortest_arc():
    poses = [[0, 0, 0, *turned_about_y(0.0)], [0.4, 0, 0, *(-np.array(turned_about_y(1.0)))]]
    pose, opening = Track.of([1.0, 3.0], poses, [1.0, 0.0]).at(np.array([0.0, 1.5, 9.0]))
    np.testing.assert_allclose(pose[:, 0], [0.0, 0.1, 0.4])
    np.testing.assert_allclose(2 * np.arctan2(pose[:, 4], pose[:, 6]), [0.0, 0.25, 1.0])
    np.testing.assert_allclose(opening, [1.0, 0.75, 0.0])


def test_a_tool_enters_at_its_first_row_and_is_at_the_end_of_each_step_from_then_on():
    poses = [[0, 0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0, 1]]

    def x_m(times_s, enters):
        placements = Track.of(times_s, poses).placements(0.25, enters=enters)
        return [None if placement is None else placement.pose[0] for placement in placements]

    assert x_m([0.0, 1.0], enters=True) == [0.0, 0.5, 0.75, 1.0]
    assert x_m([0.0, 1.0], enters=False) == [0.25, 0.5, 0.75, 1.0]
    assert x_m([0.5, 1.0], enters=True) == [None, 0.0, 0.5, 1.0]


@pytest.mark.parametrize(
    ("times_s", "field"), [([0.0], "times_s"), ([0.0, 0.0], "times_s"), ([-1.0, 0.0], "times_s"), ([0, 1], "poses")]
)
def test_rows_that_are_none_are_refused_with_their_field(times_s, field):
    poses = np.zeros((2, 7 if field == "times_s" else 6))
    with pytest.raises(kerf.InvalidArgumentError) as refused:
        Track.of(times_s, poses)
    assert refused.value.field == field
