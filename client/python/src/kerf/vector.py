"""Environments that step together, as a Gymnasium `VectorEnv`. `pip install kerf[gym]`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kerf.client import Client
from kerf.gym import CuttingEnv, Observation, Stepped
from kerf.model import StepResult
from kerf.session import Steps

try:
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise ImportError(f"this needs what `pip install kerf[gym]` installs: {error}") from error

if TYPE_CHECKING:
    Base = VectorEnv[Observation, Observation, NDArray[Any]]
else:
    Base = VectorEnv


class Episodes:
    """The episodes of an environment, one after another.

    One whose episode has ended begins the next at the next step, whatever its action is.
    """

    def __init__(self, env: CuttingEnv) -> None:
        self.env = env
        self._is_over = False

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode."""
        self._is_over = False
        return self.env.reset(seed=seed, options=options)

    def begin(self, action: NDArray[Any]) -> Steps | Stepped:
        """The steps of an action, of which `end` is to be told; or what came of it, where there is none to take."""
        if self._is_over:
            observation, info = self.reset(None, None)
            return observation, 0.0, False, False, info
        return self.env.begin(action)

    def end(self, result: StepResult) -> Stepped:
        """What the steps of an action have led to."""
        stepped = self.env.end(result)
        self._is_over = stepped[2] or stepped[3]
        return stepped

    def step(self, action: NDArray[Any]) -> Stepped:
        """Takes an action."""
        begun = self.begin(action)
        return self.end(begun.take()) if isinstance(begun, Steps) else begun


class TogetherVectorEnv(Base):
    """Many `CuttingEnv`, wherever they are."""

    def _like(self, observation_space: Any, action_space: Any, count: int) -> None:  # noqa: ANN401
        """Takes over from one of them what they all are."""
        self.num_envs = count
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        self.single_observation_space, self.single_action_space = observation_space, action_space
        self.observation_space = batch_space(observation_space, count)
        self.action_space = batch_space(action_space, count)

    @abstractmethod
    def _reset_each(
        self, seeds: Sequence[int | None], options: dict[str, Any] | None
    ) -> Sequence[tuple[Observation, dict[str, Any]]]:
        """Begins an episode of each."""

    @abstractmethod
    def _step_each(self, actions: NDArray[Any]) -> Sequence[Stepped]:
        """Steps each of them, all at once."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode of each. Of a single seed the second environment has the next one, and so on."""
        seeds = [seed + at for at in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        observations, infos = zip(*self._reset_each(seeds, options), strict=True)
        return np.stack(observations), self._together(infos)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Steps all of them at once, and waits for the last."""
        observations, rewards, terminations, truncations, infos = zip(*self._step_each(actions), strict=True)
        return (
            np.stack(observations),
            np.array(rewards, dtype=np.float64),
            np.array(terminations, dtype=np.bool_),
            np.array(truncations, dtype=np.bool_),
            self._together(infos),
        )

    def _together(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        together: dict[str, Any] = {}
        for at, info in enumerate(infos):
            together = self._add_info(together, info, at)
        return together


class CuttingVectorEnv(TogetherVectorEnv):
    """Many `CuttingEnv` on one server, stepped by one call."""

    def __init__(self, client: Client, count: int, **options: Any) -> None:  # noqa: ANN401
        """Begins the environments.

        Args:
            client: The server. The environments do not close it.
            count: How many.
            options: As of `CuttingEnv`.
        """
        self._client = client
        self._episodes = [Episodes(CuttingEnv(client, **options)) for _ in range(count)]
        first = self._episodes[0].env
        self._like(first.observation_space, first.action_space, count)

    def close_extras(self) -> None:
        """Ends the environments."""
        for each in self._episodes:
            each.env.close()

    def _reset_each(
        self, seeds: Sequence[int | None], options: dict[str, Any] | None
    ) -> Sequence[tuple[Observation, dict[str, Any]]]:
        return [each.reset(seed, options) for each, seed in zip(self._episodes, seeds, strict=True)]

    def _step_each(self, actions: NDArray[Any]) -> Sequence[Stepped]:
        begun = [each.begin(action) for each, action in zip(self._episodes, actions, strict=True)]
        results = iter(self._client.step_together([each for each in begun if isinstance(each, Steps)]))
        return [
            episodes.end(next(results)) if isinstance(each, Steps) else each
            for episodes, each in zip(self._episodes, begun, strict=True)
        ]
