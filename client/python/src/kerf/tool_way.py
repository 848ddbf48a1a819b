"""Where the tools of a session are, from what they were told, and how deep they have gone."""

from __future__ import annotations

import math
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
        # Position and way that cuts of each tool as it first touched; nothing where it does not touch.
        self._touched: list[list[float] | None] = [None] * self._tools
        # Where the jaws of each tool took hold; nothing where they hold nothing.
        self._held: list[list[float] | None] = [None] * self._tools

    def take(
        self, inputs: Sequence[Mapping[int, Motion]], flags: NDArray[np.uint32], force_n: Floats
    ) -> tuple[Floats, Floats]:
        """Poses (n, t, 7) and depths (n, t) in steps with these inputs, and what was felt in them."""
        steps = len(flags)
        poses, depth_m = np.empty((steps, self._tools, len(POSE_COLUMNS))), np.zeros((steps, self._tools))
        is_lifted: NDArray[np.bool_] = (flags & ContactFlags.LIFTED) != 0
        for step in range(steps):
            for tool, motion in (inputs[step] if step < len(inputs) else {}).items():
                self._poses[tool] = _NOWHERE if motion is None else motion.pose
            self._poses[is_lifted[step]] = np.nan
            poses[step] = self._poses
        touches: NDArray[np.bool_] = (force_n != 0.0).any(axis=2)
        holds: NDArray[np.bool_] = (flags & ContactFlags.HOLDING) != 0
        for tool in range(self._tools):
            is_in = self._touched[tool] is not None or self._held[tool] is not None
            if is_in or touches[:, tool].any() or holds[:, tool].any():
                depth_m[:, tool] = self._depths_m(tool, poses[:, tool], touches[:, tool], holds[:, tool])
        return poses, depth_m

    def _depths_m(self, tool: int, poses: Floats, touches: NDArray[np.bool_], holds: NDArray[np.bool_]) -> list[float]:
        touched, held = self._touched[tool], self._held[tool]
        depths_m = []
        for pose, is_touching, is_holding in zip(poses, touches, holds, strict=True):
            is_placed = not np.isnan(pose[0])
            held = (held or pose[:3].tolist()) if is_holding and is_placed else None
            if held is not None:
                # Jaws go any way with what they hold: up, as often as not.
                depths_m.append(math.dist(held, pose[:3].tolist()))
                continue
            if not is_placed:
                touched = None
            elif touched is None and is_touching:
                touched = [*pose[:3].tolist(), *forward(pose[None, 3:])[0].tolist()]
            gone_m = 0.0
            if touched is not None:
                x, y, z, along_x, along_y, along_z = touched
                to_x, to_y, to_z = pose[:3].tolist()
                gone_m = (to_x - x) * along_x + (to_y - y) * along_y + (to_z - z) * along_z
                # Back out, and in the air: the next touch begins anew.
                if gone_m <= 0.0 and not is_touching:
                    touched = None
            depths_m.append(max(gone_m, 0.0))
        self._touched[tool], self._held[tool] = touched, held
        return depths_m


def forward(quaternions: Floats) -> Floats:
    """The way that tools cut: -y of their frames."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return -np.stack([2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)], axis=1)
