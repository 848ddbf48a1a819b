"""Drives that are kept: to be looked at, repeated as a script, or replayed to the same state hashes."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kerf.errors import KerfError
from kerf.model import Floats, Scene, StepResult
from kerf.motion import POSE_COLUMNS, Motion, Placement

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from typing import Self

#: What a tool was told in a step.
_STAYED, _MOVED, _LIFTED = 0, 1, 2


class SessionLike(Protocol):
    """What a replay needs of a `Session`."""

    def step(self, count: int, motions: Sequence[Mapping[int | str, Motion]]) -> StepResult:
        """Takes steps, and tells tools in each of them where to go."""


class ClientLike(Protocol):
    """What a replay needs of a `Client`."""

    def create_session(self, *, toml: str, files: Mapping[str, bytes]) -> AbstractContextManager[SessionLike]:
        """Begins a session of a scene, which ends at the end of a `with`."""


@dataclass(frozen=True)
class Recording:
    """All steps of a session since its scene was at rest, with what tools were told and felt.

    With n steps, t tools, c calls.
    """

    scene_name: str
    #: The scene as it ran, and the files that it refers to.
    scene_toml: str
    files: dict[str, bytes]
    tool_names: tuple[str, ...]
    #: What each tool was told in each step: 0 nothing, 1 to go to its pose, 2 to leave the scene. (n, t)
    told: NDArray[np.uint8]
    #: Not a number where a tool was told no pose. (n, t, 7)
    poses: Floats
    #: (n, t)
    openings: Floats
    #: Of all steps.
    result: StepResult
    #: Step after which each call ended, and the state hash then. (c,)
    hash_steps: NDArray[np.int64]
    state_hashes: NDArray[np.uint64]

    def save(self, path: str | Path) -> None:
        """Writes the recording as an `.npz` file, with all that a replay needs."""
        arrays: dict[str, Any] = {
            f"result_{f.name}": np.asarray(getattr(self.result, f.name)) for f in fields(StepResult)
        }
        arrays["result_state_hash"] = np.array(self.result.state_hash, dtype=np.uint64)
        words = {"scene_name": self.scene_name, "scene_toml": self.scene_toml, "tool_names": self.tool_names}
        own = ("told", "poses", "openings", "hash_steps", "state_hashes")
        arrays |= {name: getattr(self, name) for name in own}
        arrays |= {f"file_{name}": np.frombuffer(data, dtype=np.uint8) for name, data in self.files.items()}
        with Path(path).open("wb") as out:
            np.savez_compressed(out, words=np.array(json.dumps(words)), **arrays)

    @staticmethod
    def load(path: str | Path) -> Recording:
        """Reads what `save` wrote."""
        with np.load(path, allow_pickle=False) as kept:
            words = json.loads(str(kept["words"]))
            result = {f.name: kept[f"result_{f.name}"] for f in fields(StepResult) if f"result_{f.name}" in kept}
            # Files that were written before these were kept have none.
            shape = result["cutting_length_m"].shape
            result.setdefault("poses", np.full((*shape, len(POSE_COLUMNS)), np.nan))
            result.setdefault("depth_m", np.full(shape, np.nan))
            result |= {name: int(result[name]) for name in ("topology_version", "state_hash")}
            own = {name: kept[name] for name in ("told", "poses", "openings", "hash_steps", "state_hashes")}
            files = {name.removeprefix("file_"): kept[name].tobytes() for name in kept if name.startswith("file_")}
        return Recording(
            scene_name=words["scene_name"],
            scene_toml=words["scene_toml"],
            files=files,
            tool_names=tuple(words["tool_names"]),
            result=StepResult(**result),
            **own,
        )

    def save_script(self, path: str | Path) -> None:
        """Writes the tools' way as a script, which `kerf-server simulate --script` and `kerf-load` read."""
        with Path(path).open("w", newline="") as out:
            rows = csv.writer(out, lineterminator="\n")
            rows.writerow(["time_s", "tool", *POSE_COLUMNS, "opening"])
            for step, tool in np.argwhere(self.told != _STAYED):
                time_s, name = repr(float(self.result.sim_time_s[step])), self.tool_names[tool]
                if self.told[step, tool] == _LIFTED:
                    rows.writerow([time_s, name, "lift", *[""] * len(POSE_COLUMNS)])
                else:
                    values = [*self.poses[step, tool], self.openings[step, tool]]
                    rows.writerow([time_s, name, *(repr(float(value)) for value in values)])

    def replay(self, client: ClientLike) -> StepResult:
        """Takes the same steps in a new session and compares the state hash after each call.

        Raises:
            KerfError: The states differ; it says after which step.
        """
        inputs = [self._inputs(step) for step in range(len(self.told))]
        begins = [0, *self.hash_steps[:-1]]
        with client.create_session(toml=self.scene_toml, files=self.files) as session:
            results = []
            for begin, end, state_hash in zip(begins, self.hash_steps, self.state_hashes, strict=True):
                result = session.step(int(end - begin), inputs[begin:end])
                if result.state_hash != state_hash:
                    words = f"after step {end} the state hash is {result.state_hash:016x}, not {state_hash:016x}"
                    raise KerfError(f"the replay differs: {words}")
                results.append(result)
            return StepResult.concatenated(results)

    def _inputs(self, step: int) -> dict[int | str, Motion]:
        return {
            int(tool): None
            if self.told[step, tool] == _LIFTED
            else Placement(self.poses[step, tool], float(self.openings[step, tool]))
            for tool in np.flatnonzero(self.told[step])
        }


@dataclass
class Recorder:
    """Keeps the steps of a session; `recording` is what was kept so far."""

    _scene: Scene
    _scene_toml: str
    _files: dict[str, bytes]
    on_end: Callable[[], None]
    _inputs: list[Mapping[int, Motion]] = field(default_factory=list)
    _results: list[StepResult] = field(default_factory=list)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.on_end()

    def start_over(self) -> None:
        """Forgets what was kept: the scene is at rest again."""
        self._inputs.clear()
        self._results.clear()

    def add(self, inputs: Sequence[Mapping[int, Motion]], result: StepResult) -> None:
        """Keeps the steps of a call."""
        self._inputs += inputs
        self._inputs += [{}] * (len(result) - len(inputs))
        self._results.append(result)

    def save(self, path: str | Path) -> None:
        """Writes what was kept so far as an `.npz` file, as `Recording.save`."""
        self.recording.save(path)

    def save_script(self, path: str | Path) -> None:
        """Writes what was kept so far as a script, as `Recording.save_script`."""
        self.recording.save_script(path)

    @property
    def recording(self) -> Recording:
        """What was kept so far."""
        n, tools = len(self._inputs), len(self._scene.tools)
        told = np.full((n, tools), _STAYED, dtype=np.uint8)
        poses = np.full((n, tools, len(POSE_COLUMNS)), np.nan)
        openings = np.ones((n, tools))
        for step, motions in enumerate(self._inputs):
            for tool, motion in motions.items():
                told[step, tool] = _LIFTED if motion is None else _MOVED
                if motion is not None:
                    # As the wire has them, so that a script says the same.
                    poses[step, tool] = np.asarray(motion.pose, dtype=np.float32)
                    openings[step, tool] = np.float32(motion.opening)
        return Recording(
            scene_name=self._scene.name,
            scene_toml=self._scene_toml,
            files=self._files,
            tool_names=tuple(tool.name for tool in self._scene.tools),
            told=told,
            poses=poses,
            openings=openings,
            result=StepResult.concatenated(self._results),
            hash_steps=np.array([result.steps[-1] for result in self._results], dtype=np.int64),
            state_hashes=np.array([result.state_hash for result in self._results], dtype=np.uint64),
        )
