"""Environments on all nodes of a Ray cluster, stepped together. `pip install kerf[gym,ray]`."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from kerf import cluster
from kerf.client import read_scene
from kerf.errors import UnavailableError
from kerf.gym import Observation, Stepped, make_cutting_env
from kerf.vector import Episodes, TogetherVectorEnv


class ClusterVectorEnv(TogetherVectorEnv):
    """Many `CuttingEnv`, each in a process of its own.

    They are spread over the nodes by their CPUs, and those of a node share its server.
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
                program that `KERF_SERVER_PROGRAM` names there, or `kerf-server` on the path.
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
        observation_space, action_space = self._each("begin", [()] * count)[0]
        self._like(observation_space, action_space, count)

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

    def _reset_each(
        self, seeds: Sequence[int | None], options: dict[str, Any] | None
    ) -> Sequence[tuple[Observation, dict[str, Any]]]:
        return self._each("reset", [(seed, options) for seed in seeds])

    def _step_each(self, actions: NDArray[Any]) -> Sequence[Stepped]:
        return self._each("step", [(action,) for action in actions])

    def _each(self, method: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Calls a method of each environment, of all at once."""
        answers = [env.ask(method, *given) for env, given in zip(self._envs, arguments, strict=True)]
        return [answer.get() for answer in answers]


class _Env:
    """An environment in a process of its own."""

    def __init__(self, server: cluster.NodeServer, options: Mapping[str, Any]) -> None:
        self._server, self._options = server, options

    def begin(self) -> tuple[Any, Any]:
        """Makes it; its spaces."""
        env = make_cutting_env(self._server.address(), **self._options)
        self._episodes = Episodes(env)
        return env.observation_space, env.action_space

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Observation, dict[str, Any]]:
        return self._episodes.reset(seed, options)

    def step(self, action: NDArray[Any]) -> Stepped:
        return self._episodes.step(action)

    def close(self) -> None:
        self._episodes.env.close()
