"""Where tools go: poses as arrays, and what lies between them.

A pose is seven numbers: position x, y, z in metres, then the quaternion x, y, z, w that turns the tool frame into the
scene frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kerf.errors import InvalidArgumentError
from kerf.model import Floats
from kerf.v1 import control_pb2, session_pb2, types_pb2

#: Columns of an array of poses, as in the files of scripted tools.
POSE_COLUMNS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Placement:
    """Where a tool is, and how far its jaws are open."""

    #: x, y, z in metres, then a quaternion x, y, z, w.
    pose: Floats
    #: Fraction of their full opening that jaws take, 0 (closed) to 1. Tools without jaws take no notice.
    opening: float = 1.0


#: What a tool does in a step: it moves to a placement, or, without one, leaves the scene.
Motion = Placement | None


def poses_array(poses: ArrayLike, field: str = "poses") -> Floats:
    """N x 7 finite numbers; a single pose is a row."""
    array = np.atleast_2d(np.asarray(poses, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != len(POSE_COLUMNS):
        raise InvalidArgumentError(f"{field}: shape {array.shape}", field=field, limit="shape (N, 7)")
    if not np.isfinite(array).all():
        raise InvalidArgumentError(f"{field}: must be finite", field=field, limit="finite")
    return array


@dataclass(frozen=True)
class Track:
    """One tool over time; between two rows it moves evenly and turns about a fixed axis."""

    times_s: Floats
    poses: Floats
    openings: Floats

    @staticmethod
    def of(times_s: ArrayLike, poses: ArrayLike, openings: ArrayLike | None = None) -> Track:
        """Checks the rows: times ascend and are as many as the poses."""
        array = poses_array(poses)
        times = np.asarray(times_s, dtype=np.float64)
        if times.shape != (len(array),):
            limit = f"shape ({len(array)},), one for each pose"
            raise InvalidArgumentError(f"times_s: shape {times.shape}", field="times_s", limit=limit)
        if not np.isfinite(times).all() or (np.diff(times) <= 0).any() or times[0] < 0:
            raise InvalidArgumentError("times_s: must ascend from 0 or later", field="times_s", limit="ascending")
        opened = np.broadcast_to(np.asarray(1.0 if openings is None else openings, dtype=np.float64), times.shape)
        return Track(times, array, opened)

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Poses and openings at these times; before the first row and after the last those of the row."""
        after = np.clip(np.searchsorted(self.times_s, times_s, side="right"), 1, max(len(self.times_s) - 1, 1))
        if len(self.times_s) == 1:
            return np.repeat(self.poses, len(times_s), axis=0), np.repeat(self.openings, len(times_s))
        before = after - 1
        span = self.times_s[after] - self.times_s[before]
        share = np.clip((times_s - self.times_s[before]) / span, 0.0, 1.0)
        column = share[:, None]
        position_m = (1.0 - column) * self.poses[before, :3] + column * self.poses[after, :3]
        turned = _slerp(self.poses[before, 3:], self.poses[after, 3:], column)
        opening = (1.0 - share) * self.openings[before] + share * self.openings[after]
        return np.hstack([position_m, turned]), opening

    def placements(self, dt_s: float, *, enters: bool) -> list[Placement | None]:
        """Where the tool is at the end of each step of `dt_s` from time 0 on, to the step that reaches the last row.

        `None` stands for steps that end before the first row. A tool that `enters` does so where its first row has it
        and moves from the step after on: were it put down where it is at the step's end, it might have jumped the
        tissue's surface.
        """
        # Times that are meant as the end of a step may be off by rounding.
        rounding_s = 1e-9 * dt_s
        steps = max(int(np.ceil((self.times_s[-1] - rounding_s) / dt_s)), 1)
        ends_s: Floats = dt_s * np.arange(1.0, steps + 1.0)
        first = int(np.searchsorted(ends_s, self.times_s[0] - rounding_s))
        poses, openings = self.at(ends_s[first:])
        if enters:
            poses[0], openings[0] = self.poses[0], self.openings[0]
        placed = [Placement(pose, float(opening)) for pose, opening in zip(poses, openings, strict=True)]
        return [None] * first + placed


def _slerp(start: Floats, end: Floats, share: Floats) -> Floats:
    start, end = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (start, end))
    dot = np.sum(start * end, axis=1, keepdims=True)
    end = np.where(dot < 0.0, -end, end)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    sine = np.sin(angle)
    # Of quaternions that hardly differ the chord is the arc.
    near = sine < 1e-9
    safe = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    second = np.where(near, share, np.sin(share * angle) / safe)
    turned = first * start + second * end
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def write_pose(message: control_pb2.ToolPose, tool: int, placement: Placement) -> None:
    """A placement as the wire states it."""
    message.tool_id, message.opening = tool, placement.opening
    at, turned = message.pose.position_m, message.pose.orientation
    at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w = np.asarray(placement.pose).tolist()


def read_pose(message: types_pb2.Pose) -> Floats:
    """A pose as the wire states it."""
    at, turned = message.position_m, message.orientation
    return np.array([at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w])


def write_motions(message: session_pb2.StepInput, motions: dict[int, Motion]) -> None:
    """What tools do in one step, as the wire states it."""
    for tool, motion in motions.items():
        if motion is None:
            message.motions.add(lift=control_pb2.LiftTool(tool_id=tool))
        else:
            write_pose(message.motions.add().pose, tool, motion)
