"""Environments on all nodes of a Ray cluster, stepped together. `pip install kerf[gym,ray]`."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kerf import cluster
from kerf.client import read_scene
from kerf.errors import UnavailableError
from kerf.gym import Observation, make_cutting_env

try:
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise ImportError(f"this needs what `pip install kerf[gym]` installs: {error}") from error

if TYPE_CHECKING:
    Base = VectorEnv[Observation, Observation, NDArray[Any]]
else:
    Base = VectorEnv


class ClusterVectorEnv(Base):
    """Many `CuttingEnv`, each in a process of its own, as a Gymnasium `VectorEnv`.

    They are spread over the nodes by their CPUs, and those of a node share its server. One whose episode has ended
    begins the next at the next step, whatever its action is.
    """

    def __init__(
        self,
        count: int,
        *,
        server: str | None = None,
        settings: Mapping[str, object] | None = None,
        **options: Any,  # noqa: ANN401
    ) -> None:
        """Begins the environments.

        Args:
            count: How many.
            server: Where a node finds a server, as seen from the node. Without it each node starts one of its own: the
                program that `KERF_SERVER` names there, or `kerf-server` on the path.
            settings: Of servers that are started, as of `LocalServer`.
            options: As of `make_cutting_env`. A file that `path` names is read here.
        """
        if "path" in options:
            options["toml"], options["files"] = read_scene(options.pop("path"))
        self._servers: dict[str, cluster.NodeServer] = {}
        self._envs: list[cluster.Actor] = []
        cluster.connect()
        # Each node once for each of its CPUs, in turns, so that few environments are on many nodes, too.
        turns = sorted((turn / cpus, node) for node, cpus in cluster.nodes().items() for turn in range(cpus))
        if not turns:
            raise UnavailableError("the cluster has no node with a CPU")
        #: The node of each environment, by Ray's id.
        self.nodes = tuple(turns[at % len(turns)][1] for at in range(count))
        self._servers = {node: cluster.NodeServer(node, server, settings or {}) for node in self.nodes[: len(turns)]}
        shared = cluster.shared(options)
        self._envs = [cluster.Actor(node, _Env, self._servers[node], shared) for node in self.nodes]
        self.num_envs = count
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        self.single_observation_space, self.single_action_space = self._each("begin", [()] * count)[0]
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode of each. Of a single seed the second environment has the next one, and so on."""
        seeds = [seed + at for at in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        observations, infos = zip(*self._each("reset", [(one, options) for one in seeds]), strict=True)
        return np.stack(observations), self._together(infos)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Steps all of them at once, and waits for the last."""
        answers = self._each("step", [(action,) for action in actions])
        observations, rewards, terminations, truncations, infos = zip(*answers, strict=True)
        return (
            np.stack(observations),
            np.array(rewards, dtype=np.float64),
            np.array(terminations, dtype=np.bool_),
            np.array(truncations, dtype=np.bool_),
            self._together(infos),
        )

    def close_extras(self) -> None:
        """Ends the environments, and the servers that were started for them."""
        # Sessions on a server that goes on would wait for its idle timeout. One whose process is gone has to.
        for answer in [env.ask("close") for env in self._envs]:
            with contextlib.suppress(cluster.LostError):
                answer.get()
        for env in self._envs:
            env.stop()
        for server in self._servers.values():
            server.stop()

    def _each(self, method: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Calls a method of each environment, of all at once."""
        answers = [env.ask(method, *given) for env, given in zip(self._envs, arguments, strict=True)]
        return [answer.get() for answer in answers]

    def _together(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        together: dict[str, Any] = {}
        for at, info in enumerate(infos):
            together = self._add_info(together, info, at)
        return together


class _Env:
    """An environment in a process of its own."""

    def __init__(self, server: cluster.NodeServer, options: Mapping[str, Any]) -> None:
        self._server, self._options = server, options
        self._is_over = False

    def begin(self) -> tuple[Any, Any]:
        """Makes it; its spaces."""
        self._env = make_cutting_env(self._server.address(), **self._options)
        return self._env.observation_space, self._env.action_space

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Observation, dict[str, Any]]:
        self._is_over = False
        return self._env.reset(seed=seed, options=options)

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if self._is_over:
            observation, info = self.reset(None, None)
            return observation, 0.0, False, False, info
        stepped = self._env.step(action)
        self._is_over = stepped[2] or stepped[3]
        return stepped

    def close(self) -> None:
        self._env.close()
