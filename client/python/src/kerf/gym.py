"""A Gymnasium environment around a session: cutting as a task to learn.

`gymnasium.make("kerf/Cut-v0")` makes one, on a server of its own or at `address`. Gymnasium is optional
(`pip install kerf[gym]`). Without it `CuttingEnv` is a class of the same methods, and its spaces
are plain boxes with `low`, `high`, `shape` and `sample`.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kerf.client import Client
from kerf.errors import InvalidArgumentError
from kerf.local_server import LocalServer
from kerf.model import Floats, StepResult
from kerf.motion import Motion, Placement, poses_array
from kerf.picture import Painter
from kerf.session import Steps, ToolRef
from kerf.view import View

try:
    from gymnasium import Env as _Env
    from gymnasium.spaces import Box
except ImportError:

    @dataclass
    class Box:  # type: ignore[no-redef]
        """Numbers between two bounds, as Gymnasium's."""

        low: Any
        high: Any
        shape: tuple[int, ...]
        dtype: Any = np.float32

        def __post_init__(self) -> None:
            self._random = np.random.default_rng()

        def seed(self, seed: int | None = None) -> None:
            """Begins the samples anew."""
            self._random = np.random.default_rng(seed)

        def sample(self) -> NDArray[Any]:
            """Any of them, evenly."""
            return self._random.uniform(self.low, self.high, self.shape).astype(self.dtype)

    class _Env:  # type: ignore[no-redef]
        """As much of Gymnasium's as `CuttingEnv` needs."""

        np_random: np.random.Generator

        def __class_getitem__(cls, _: object) -> type:
            return cls

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> None:  # noqa: ARG002
            """Begins the random numbers anew where a seed is given."""
            if seed is not None or not hasattr(self, "np_random"):
                self.np_random = np.random.default_rng(seed)


if TYPE_CHECKING:
    Base = _Env[NDArray[np.float32], NDArray[np.float32]]
else:
    Base = _Env[np.ndarray, np.ndarray]

Observation = NDArray[np.float32]
#: What an action answers with: what is seen, the reward, whether the task is done, whether time is up, and more.
Stepped = tuple[Observation, float, bool, bool, dict[str, Any]]

#: Under this name the state is kept that every episode begins with.
_START = "episode"


@dataclass(frozen=True)
class Moment:
    """What a reward is made of: the tool and the tissue before and after an action."""

    #: Pose of the tool after the action; seven numbers.
    pose: Floats
    #: What the steps of the action have led to.
    result: StepResult
    #: What the steps of the action before have led to.
    before: StepResult

    def gained_j(self, term: str) -> float:
        """By how much an energy has grown in the action, by its name without the unit (`"fracture"`)."""
        return float(self.result.energy_j(term)[-1] - self.before.energy_j(term)[-1])


def cut_area_reward(moment: Moment) -> float:
    """The energy that went into new cuts, J: Gc times their area."""
    return moment.gained_j("fracture")


class CuttingEnv(Base):
    """A tool that is moved through tissue, a few steps an action, as fast as the machine steps.

    An action is six numbers from -1 to 1: velocity along the scene's x, y, z as a share of `max_speed_m_per_s`, and
    turning about the tool's x, y, z as a share of `max_turn_rad_per_s`. With `controls_opening` a seventh opens (1) and
    closes (-1) the jaws.

    With `render_mode="rgb_array"` `render` draws the tissue and the tools.

    An observation is flat: the tool's position (3) and quaternion (4), the force (3) and torque (3) on it, the length
    of the edge that cuts (1), then the displacement of each tracked point (3 each). Override `observe` for another one,
    and `observation_space` with it.

    The same seed and the same actions give the same observations and the same `info["state_hash"]`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 25}  # noqa: RUF012

    def __init__(
        self,
        client: Client,
        scene: str = "jelly",
        *,
        start_pose: ArrayLike,
        tool: ToolRef = 0,
        steps_per_action: int = 10,
        max_actions: int = 500,
        max_speed_m_per_s: float = 0.1,
        max_turn_rad_per_s: float = 1.0,
        start_spread_m: float = 0.0,
        settle_steps: int = 0,
        controls_opening: bool = False,
        reward: Callable[[Moment], float] = cut_area_reward,
        is_done: Callable[[Moment], bool] = lambda _: False,
        render_mode: str | None = None,
        picture_size: tuple[int, int] = (480, 360),
        **session_options: Any,  # noqa: ANN401
    ) -> None:
        """Builds the scene, and lets it come to rest.

        Args:
            client: The server. The environment does not close it.
            scene: One of `client.scenes()`, or nothing with `path` or `toml` among the session's options.
            start_pose: Where the tool is at the beginning of an episode, outside the tissue; seven numbers.
            tool: Name or index of the tool that is moved.
            steps_per_action: Steps that an action lasts.
            max_actions: Actions after which an episode is truncated.
            max_speed_m_per_s: Speed that an action of 1 means.
            max_turn_rad_per_s: Rate of turning that an action of 1 means.
            start_spread_m: The start is moved by up to this along each axis, by the seed.
            settle_steps: Steps before the first episode in which nothing is touched, so that weight has acted.
            controls_opening: Whether an action has a seventh number.
            reward: What an action was worth.
            is_done: Whether the task is done; the episode ends then.
            render_mode: `"rgb_array"`, or nothing: `render` answers with nothing then.
            picture_size: Width and height of a picture, pixels.
            session_options: As of `Client.create_session`.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            limit = f"one of {', '.join(self.metadata['render_modes'])}, or None"
            raise InvalidArgumentError(f"render_mode: {render_mode!r} is not {limit}", field="render_mode", limit=limit)
        self.render_mode = render_mode
        self._picture_size = picture_size
        self._painter: Painter | None = None
        self._view: View | None = None
        named = scene if not {"path", "toml"} & session_options.keys() else None
        self.session = client.create_session(named, **session_options)
        self._tool = self.session.tool_index(tool)
        self._start_pose = poses_array(start_pose, "start_pose")[0]
        self._steps = steps_per_action
        self._max_actions = max_actions
        action_s = steps_per_action * self.session.scene.dt_s
        self._reach_m, self._turn_rad = max_speed_m_per_s * action_s, max_turn_rad_per_s * action_s
        self._spread_m = start_spread_m
        self._reward, self._is_done = reward, is_done
        self._actions = 0
        size = 7 if controls_opening else 6
        self.action_space = Box(-1.0, 1.0, (size,), np.float32)
        points = len(self.session.scene.tracked_point_names)
        self.observation_space = Box(-np.inf, np.inf, (14 + 3 * points,), np.float32)
        if settle_steps:
            self.session.step(settle_steps)
        self.session.save_checkpoint(_START)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode: the tissue whole, the tool at its start."""
        super().reset(seed=seed, options=options)
        self.session.restore_checkpoint(_START)
        self._actions = 0
        self._pose = self._start_pose.copy()
        self._pose[:3] += self.np_random.uniform(-self._spread_m, self._spread_m, 3)
        self._opening = 1.0
        self._result = self.session.step(1, [{self._tool: Placement(self._pose, self._opening)}])
        return self.observe(self._pose, self._result), self._info()

    def step(self, action: ArrayLike) -> Stepped:
        """Moves the tool for `steps_per_action` steps."""
        return self.end(self.begin(action).take())

    def begin(self, action: ArrayLike) -> Steps:
        """The steps of an action, for whoever steps many environments at once and tells `end` what they led to."""
        return Steps(self.session, self._steps, self._motions(action))

    def end(self, result: StepResult) -> Stepped:
        """What `step` answers with, after the steps of an action."""
        moment = Moment(self._pose.copy(), result, self._result)
        self._result = result
        self._actions += 1
        terminated, truncated = bool(self._is_done(moment)), self._actions >= self._max_actions
        return self.observe(self._pose, result), float(self._reward(moment)), terminated, truncated, self._info()

    def _motions(self, action: ArrayLike) -> list[dict[ToolRef, Motion | ArrayLike]]:
        wanted = np.asarray(action, dtype=np.float64)
        if wanted.shape != self.action_space.shape:
            limit = f"shape {self.action_space.shape}"
            raise InvalidArgumentError(f"action: shape {wanted.shape}", field="action", limit=limit)
        return [{self._tool: motion} for motion in self._way(np.clip(wanted, -1.0, 1.0))]

    def observe(self, pose: Floats, result: StepResult) -> Observation:
        """What the agent sees of the last step."""
        tool = self._tool
        seen = [
            pose,
            result.force_n[-1, tool],
            result.torque_nm[-1, tool],
            result.cutting_length_m[-1, [tool]],
            result.tracked_displacements_m[-1].reshape(-1),
        ]
        return np.concatenate(seen).astype(np.float32)

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the tissue and the tools after the last step: rows of red, green and blue."""
        if self.render_mode is None:
            return None
        if self._painter is None or self._view is None:
            objects = self.session.scene.objects
            rest_min_m = np.min([known.rest_min_m for known in objects], axis=0)
            rest_max_m = np.max([known.rest_max_m for known in objects], axis=0)
            self._painter = Painter(rest_min_m, rest_max_m, self.session.scene.tools, self._picture_size)
            self._view = self.session.view()
        # A way back to the start may be behind what was seen before: what is shown is as of this step, or newer.
        surfaces = self._view.surfaces()
        while surfaces[0].step != self._result.steps[-1]:
            surfaces = self._view.surfaces(step=int(self._result.steps[-1]))
        return self._painter.picture(surfaces, self._result.poses[-1])

    def close(self) -> None:
        """Ends the session."""
        if self._view is not None:
            self._view.close()
            self._view = None
        self.session.close()

    def _way(self, wanted: Floats) -> list[Motion]:
        """Evenly from where the tool is to where the action has it; the pose is there afterwards."""
        start, start_opening = self._pose.copy(), self._opening
        if len(wanted) > 6:
            self._opening = (wanted[6] + 1.0) / 2.0
        share = np.arange(1.0, self._steps + 1.0) / self._steps
        positions_m = start[:3] + share[:, None] * (self._reach_m * wanted[:3])
        poses = np.hstack([positions_m, _turned(start[3:], share[:, None] * (self._turn_rad * wanted[3:6]))])
        openings = start_opening + share * (self._opening - start_opening)
        self._pose = poses[-1].copy()
        return [Placement(pose, opening) for pose, opening in zip(poses, openings.tolist(), strict=True)]

    def _info(self) -> dict[str, Any]:
        last = self._result
        # Of 64 bits and no sign: vectors of environments keep it in an array.
        return {"state_hash": np.uint64(last.state_hash), "step": int(last.steps[-1]), "energy": last.energy}


def make_cutting_env(address: str | None = None, **options: Any) -> CuttingEnv:  # noqa: ANN401
    """An environment with a connection of its own: `gymnasium.make("kerf/Cut-v0", ...)`.

    Args:
        address: The server. Without one this process starts its own, once: the program that `KERF_SERVER_PROGRAM`
            names, or `kerf-server` on the path.
        options: As of `CuttingEnv`. The scene is `jelly`, and the tool begins above its middle, unless they say so.
    """
    options = {"start_pose": [0.0, 0.06, 0.0, 0.0, 0.0, 0.0, 1.0], **options}
    return _OwnClientEnv(address, **options)


class _OwnClientEnv(CuttingEnv):
    """Closes its connection too, and the server of this process with the last of them that uses it."""

    _server: ClassVar[LocalServer | None] = None
    #: A process that was forked has its parent's server in memory, and may neither use nor end it.
    _server_of_process: ClassVar[int] = 0
    _users: ClassVar[int] = 0

    def __init__(self, address: str | None, **options: Any) -> None:  # noqa: ANN401
        self._uses_server = address is None
        self._client = Client(address or self._shared_server().address)
        try:
            super().__init__(self._client, **options)
        except BaseException:
            self._leave()
            raise

    def close(self) -> None:
        super().close()
        self._leave()

    def _leave(self) -> None:
        self._client.close()
        kind = _OwnClientEnv
        if not self._uses_server or kind._server_of_process != os.getpid():
            return
        self._uses_server = False
        kind._users -= 1
        if kind._users == 0 and kind._server is not None:
            kind._server.stop()
            kind._server = None

    @staticmethod
    def _shared_server() -> LocalServer:
        kind = _OwnClientEnv
        if kind._server is None or kind._server_of_process != os.getpid():
            kind._server = LocalServer.of_environment()
            kind._server_of_process, kind._users = os.getpid(), 0
            # Environments that nobody closes.
            atexit.register(kind._server.stop)
        kind._users += 1
        return kind._server


def register() -> None:
    """Makes the ids of the environments known to Gymnasium, which calls this by itself where it is installed."""
    from gymnasium.envs.registration import register as known
    from gymnasium.envs.registration import registry

    if "kerf/Cut-v0" not in registry:
        known("kerf/Cut-v0", entry_point="kerf.gym:make_cutting_env")


def _turned(quaternion: Floats, rotations_rad: Floats) -> Floats:
    """The quaternion x, y, z, w after each of some rotations about the tool's own axes."""
    angle = np.linalg.norm(rotations_rad, axis=1)
    axis = rotations_rad / np.where(angle > 0.0, angle, 1.0)[:, None]
    (x, y, z), w = np.sin(angle / 2.0) * axis.T, np.cos(angle / 2.0)
    a, b, c, d = quaternion / np.linalg.norm(quaternion)
    turned = [
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    ]
    return np.stack(turned, axis=1)
