"""Where the tools of a session are, from what they were told, and how deep they have gone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kerf.model import ContactFlags, Floats
from kerf.motion import POSE_COLUMNS, Motion

_NOWHERE = np.full(len(POSE_COLUMNS), np.nan)


class ToolWay:
    """Follows the tools of one session from step to step."""

    def __init__(self, tools: int) -> None:
        self._tools = tools
        self.forget()

    def forget(self) -> None:
        """The session is in another state, in which the tools are who knows where."""
        self._poses = np.tile(_NOWHERE, (self._tools, 1))
        # Pose of each tool as it first touched.
        self._touched = self._poses.copy()

    def take(
        self, inputs: Sequence[Mapping[int, Motion]], flags: NDArray[np.uint32], force_n: Floats
    ) -> tuple[Floats, Floats]:
        """Poses (n, t, 7) and depths (n, t) in steps with these inputs, and what was felt in them."""
        steps = len(flags)
        poses, depth_m = np.empty((steps, self._tools, len(POSE_COLUMNS))), np.zeros((steps, self._tools))
        for step in range(steps):
            for tool, motion in (inputs[step] if step < len(inputs) else {}).items():
                self._poses[tool] = _NOWHERE if motion is None else motion.pose
            self._poses[(flags[step] & ContactFlags.LIFTED) != 0] = np.nan
            poses[step] = self._poses
            touches = force_n[step].any(axis=1)
            depth_m[step] = self._depths_m(touches)
        return poses, depth_m

    def _depths_m(self, touches: NDArray[np.bool_]) -> Floats:
        begins = touches & np.isnan(self._touched[:, 0])
        self._touched[begins] = self._poses[begins]
        along = forward(self._touched[:, 3:])
        gone_m = np.sum((self._poses[:, :3] - self._touched[:, :3]) * along, axis=1)
        # Back out, and in the air: the next touch begins anew.
        self._touched[np.isnan(gone_m) | (~touches & (gone_m <= 0.0))] = np.nan
        return np.where(np.isnan(gone_m), 0.0, np.maximum(gone_m, 0.0))


def forward(quaternions: Floats) -> Floats:
    """The way that tools cut: -y of their frames."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return -np.stack([2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)], axis=1)
