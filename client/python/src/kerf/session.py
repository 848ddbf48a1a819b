"""A session: its life, its steps, its checkpoints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from kerf import model
from kerf.control import Control
from kerf.errors import KerfError, MovedError, NotFoundError, did_you_mean
from kerf.model import Checkpoint, ContactFlags, SessionStatus, StepResult
from kerf.motion import Motion, Placement, Track, poses_array, write_motions
from kerf.recording import Recorder
from kerf.rpc import Following, Transport, parts_of
from kerf.tool_way import ToolWay
from kerf.v1 import session_pb2 as pb
from kerf.view import View

if TYPE_CHECKING:
    from typing import Self

    from kerf.replica import Surface

#: A tool, by its name or its index.
ToolRef = int | str

#: Most steps that a server takes in one call.
MAX_STEPS_PER_CALL = 1000
#: Most steps of all sessions in one call.
_STEPS_TOGETHER = 10_000
#: Steps of one call of a long drive: few enough that a call on a large scene is answered in time.
_STEPS_PER_CALL = 100

_STEP = "SessionService/StepSession"


class Session:
    """A scene that is simulated on a server.

    A session that was created without `real_time` stands, and moves by `step` and `drive` alone: the same calls lead to
    the same `state_hash`. As a context manager it closes the session at the end, unless it was only joined.
    """

    def __init__(
        self,
        transport: Transport,
        description: pb.SessionDescription,
        *,
        warnings: Sequence[str] = (),
        files: Mapping[str, bytes] | None = None,
        owned: bool = True,
    ) -> None:
        self.id = description.session_id
        #: What is simulated.
        self.scene = model.scene(description.scene)
        #: What the scene can run with but hardly means.
        self.warnings = tuple(warnings)
        #: Speed of a tool above which a pose is refused, m/s.
        self.max_tool_speed_m_per_s = description.limits.max_tool_speed_m_per_s
        #: Meshes, label maps and edges that the scene was sent with.
        self.files = dict(files or {})
        self._transport = Following(transport)
        self._owned = owned
        self._recorder: Recorder | None = None
        self._tools_in_scene: set[int] = set()
        self._way = ToolWay(len(self.scene.tools))

    def __repr__(self) -> str:
        return f"Session({self.id!r}, scene={self.scene.name!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._owned:
            self.close()

    # Life

    def describe(self) -> SessionStatus:
        """How the session is doing after its last step."""
        request = pb.DescribeSessionRequest(session_id=self.id)
        answer = self._transport.call("SessionService/DescribeSession", request, pb.DescribeSessionResponse)
        return model.session_status(answer.session)

    def close(self) -> None:
        """Ends the session. One that has ended already is left alone."""
        try:
            request = pb.CloseSessionRequest(session_id=self.id)
            self._transport.call("SessionService/CloseSession", request, pb.CloseSessionResponse)
        except NotFoundError:
            pass

    def move(self, to: str, *, token: str = "", ca_file: str | Path | None = None) -> int:
        """Moves the session to another server, where this goes on with it; the step that it goes on from.

        A `view` of it follows. A `control` ends with `MovedError`, and the next one begins there.

        Args:
            to: The other server, as `"http://NAME:PORT"` or `"https://NAME:PORT"`: as its clients reach it.
            token: An operator's token of that server; empty where it asks for none.
            ca_file: Certificates of those who are trusted to sign that server's; `None`: the system's.
        """
        certificates = "" if ca_file is None else Path(ca_file).read_text(encoding="utf-8")
        request = pb.MoveSessionRequest(session_id=self.id, to=to, token=token, ca_certificates=certificates)
        return self._transport.call("SessionService/MoveSession", request, pb.MoveSessionResponse).step

    def pause(self) -> int:
        """Stops a session that steps by itself; the step after which it stands."""
        request = pb.PauseSessionRequest(session_id=self.id)
        return self._transport.call("SessionService/PauseSession", request, pb.PauseSessionResponse).step

    def resume(self) -> int:
        """Lets the session step by itself, in real time; the step from which it goes on."""
        request = pb.ResumeSessionRequest(session_id=self.id)
        return self._transport.call("SessionService/ResumeSession", request, pb.ResumeSessionResponse).step

    def reset(self) -> None:
        """Puts the scene back to rest: step 0, every tool lifted."""
        request = pb.ResetSessionRequest(session_id=self.id)
        self._transport.call("SessionService/ResetSession", request, pb.ResetSessionResponse)
        self._forget_tools()
        if self._recorder is not None:
            self._recorder.start_over()

    def scene_toml(self) -> str:
        """The text of the scene as it runs; meshes and label maps are not in it."""
        request = pb.GetSceneRequest(session_id=self.id)
        return self._transport.call("SessionService/GetScene", request, pb.GetSceneResponse).scene_toml

    def tool_index(self, tool: ToolRef) -> int:
        """The index of a tool of the scene."""
        names = [known.name for known in self.scene.tools]
        if isinstance(tool, str) and tool in names:
            return names.index(tool)
        if isinstance(tool, int) and 0 <= tool < len(names):
            return tool
        guess = did_you_mean(tool, names) if isinstance(tool, str) else ""
        words = f"no tool {tool!r} among {', '.join(names)}{guess}"
        raise NotFoundError(words, field="tool", limit=f"one of {', '.join(names)}")

    # Steps

    def step(self, count: int = 1, motions: Sequence[Mapping[ToolRef, Motion | ArrayLike]] = ()) -> StepResult:
        """Takes up to 1000 steps as fast as the machine does, and stands after them.

        Args:
            count: How many.
            motions: What tools do in each of them: a placement or a pose of seven numbers to go to, or to enter at;
                `None` lifts. Tools stay where they are in steps beyond, as do those that are not named.
        """
        return self._step(count, self._inputs(motions))

    def drive(
        self, times_s: ArrayLike, poses: ArrayLike, *, tool: ToolRef = 0, openings: ArrayLike | None = None
    ) -> StepResult:
        """Moves a tool through poses, a step after the other, and says what each step has led to.

        The tool moves evenly between two rows, as scripted tools of `kerf-server simulate` do, and stays in the scene
        at the end.

        Args:
            times_s: When the tool is at each pose, s, ascending; 0 is now. (N,)
            poses: Position in metres and quaternion x, y, z, w. (N, 7)
            tool: Its name or index.
            openings: Fraction of their full opening that jaws take at each pose. (N,)
        """
        index = self.tool_index(tool)
        track = Track.of(times_s, poses, openings)
        placements = track.placements(self.scene.dt_s, enters=index not in self._tools_in_scene)
        inputs: list[dict[int, Motion]] = [{} if to is None else {index: to} for to in placements]
        chunks = (inputs[at : at + _STEPS_PER_CALL] for at in range(0, len(inputs), _STEPS_PER_CALL))
        return StepResult.concatenated(self._step(len(chunk), chunk) for chunk in chunks)

    def lift(self, tool: ToolRef = 0) -> StepResult:
        """Takes a tool out of the scene, in a step of its own."""
        return self._step(1, [{self.tool_index(tool): None}])

    def _inputs(self, motions: Sequence[Mapping[ToolRef, Motion | ArrayLike]]) -> list[dict[int, Motion]]:
        return [{self.tool_index(tool): _motion(motion) for tool, motion in each.items()} for each in motions]

    def _request(self, count: int, inputs: Sequence[dict[int, Motion]]) -> pb.StepSessionRequest:
        request = pb.StepSessionRequest(session_id=self.id, steps=count)
        for each in inputs:
            write_motions(request.inputs.add(), each)
        return request

    def _step(self, count: int, inputs: Sequence[dict[int, Motion]]) -> StepResult:
        return self._stepped(inputs, self._transport.call(_STEP, self._request(count, inputs), pb.StepSessionResponse))

    def _stepped(self, inputs: Sequence[dict[int, Motion]], answer: pb.StepSessionResponse) -> StepResult:
        result = model.step_result(answer)
        poses, depth_m = self._way.take(inputs, result.flags, result.force_n)
        result = replace(result, poses=poses, depth_m=depth_m)
        lifted = result.flags[-1] & ContactFlags.LIFTED
        self._tools_in_scene = {tool for tool, is_lifted in enumerate(lifted) if not is_lifted}
        if self._recorder is not None:
            self._recorder.add(inputs, result)
        return result

    # Checkpoints

    def save_checkpoint(self, name: str) -> int:
        """Saves the state to go back to, in place of one of the same name; its step."""
        request = pb.SaveCheckpointRequest(session_id=self.id, name=name)
        return self._transport.call("SessionService/SaveCheckpoint", request, pb.SaveCheckpointResponse).step

    def restore_checkpoint(self, name: str) -> int:
        """Goes back to a checkpoint, with the tools that this has placed where they were; its step."""
        self._refuse_while_recorded()
        request = pb.RestoreCheckpointRequest(session_id=self.id, name=name)
        with self._guessing_checkpoint(name):
            answer = self._transport.call("SessionService/RestoreCheckpoint", request, pb.RestoreCheckpointResponse)
        self._forget_tools()
        return answer.step

    def _forget_tools(self) -> None:
        self._tools_in_scene.clear()
        self._way.forget()

    def checkpoints(self) -> list[Checkpoint]:
        """What can be gone back to, in the order of saving."""
        request = pb.ListCheckpointsRequest(session_id=self.id)
        answer = self._transport.call("SessionService/ListCheckpoints", request, pb.ListCheckpointsResponse)
        return [Checkpoint(c.name, c.step, c.sim_time_s) for c in answer.checkpoints]

    def delete_checkpoint(self, name: str) -> None:
        """Forgets a checkpoint."""
        request = pb.DeleteCheckpointRequest(session_id=self.id, name=name)
        with self._guessing_checkpoint(name):
            self._transport.call("SessionService/DeleteCheckpoint", request, pb.DeleteCheckpointResponse)

    @contextmanager
    def _guessing_checkpoint(self, name: str) -> Iterator[None]:
        """Where the server has no checkpoint of this name the error says which there are, and which may be meant."""
        try:
            yield
        except MovedError:
            raise
        except NotFoundError as error:
            # Where it is the session that is gone, this says so.
            known = [kept.name for kept in self.checkpoints()]
            if not known or name in known:
                raise
            words = f"{error} among {', '.join(known)}{did_you_mean(name, known)}"
            raise NotFoundError(words, field="name", limit=f"one of {', '.join(known)}") from error

    def save(self, path: str | Path, checkpoint: str = "") -> None:
        """Writes the state to a file, or a checkpoint: `load` goes on from it in another session of the same scene.

        Args:
            path: The file.
            checkpoint: Name of a checkpoint; empty: the state as it is.
        """
        request = pb.DownloadCheckpointRequest(session_id=self.id, name=checkpoint)
        with self._guessing_checkpoint(checkpoint):
            parts = self._transport.read("SessionService/DownloadCheckpoint", request, pb.DownloadCheckpointResponse)
            state = b"".join(part.data for part in parts)
        Path(path).write_bytes(state)

    def load(
        self,
        path: str | Path,
        checkpoint: str = "",
        *,
        restore: bool = True,
        progress: Callable[[int, int], object] | None = None,
    ) -> int:
        """Keeps the state in a file of `save` as a checkpoint and goes to it; its step.

        The file is of the same scene, step rate and dial included, in this or another server of the same version.

        Args:
            path: The file.
            checkpoint: Name to keep it by; empty: the file's, without its ending.
            restore: Whether to go to it; `restore_checkpoint` does so later.
            progress: Called with the bytes that were sent and those that there are, from another thread.
        """
        if restore:
            self._refuse_while_recorded()
        file, name = Path(path).read_bytes(), checkpoint or Path(path).stem
        method = "SessionService/UploadCheckpoint"
        parts = partial(_upload, self.id, name, file, progress)
        step = self._transport.send(method, parts, pb.UploadCheckpointRequest, pb.UploadCheckpointResponse).step
        return self.restore_checkpoint(name) if restore else step

    def _refuse_while_recorded(self) -> None:
        if self._recorder is not None:
            raise KerfError("a drive that is recorded cannot go back to a checkpoint; it can be reset")

    # What is seen, felt and kept

    def view(self, rate_hz: float = 60.0) -> View:
        """Follows the surface from now on; a context manager."""
        return View(self._transport, self.id, self.scene.objects, rate_hz)

    def surfaces(self) -> list[Surface]:
        """The surface of each object as it is now. Who looks often follows a `view`."""
        with self.view() as view:
            return view.surfaces()

    def control(self, *tools: ToolRef, contact_rate_hz: float = 0.0) -> Control:
        """Drives tools of a session that steps by itself, in real time; a context manager."""
        indices = [self.tool_index(tool) for tool in tools or (0,)]
        return Control(self._transport, self.id, indices, contact_rate_hz)

    def record(self) -> Recorder:
        """Keeps all steps from now on, for a file and a replay; a context manager. The scene is at rest then."""
        if self.describe().step != 0:
            raise KerfError("a recording begins with the scene at rest: reset the session first")
        recorder = Recorder(self.scene, self.scene_toml(), self.files, on_end=self._end_recording)
        self._recorder = recorder
        return recorder

    def _end_recording(self) -> None:
        self._recorder = None


def _upload(
    session_id: str, name: str, file: bytes, progress: Callable[[int, int], object] | None
) -> Iterator[pb.UploadCheckpointRequest]:
    yield pb.UploadCheckpointRequest(session_id=session_id, name=name)
    sent = 0
    for part in parts_of(file):
        yield pb.UploadCheckpointRequest(data=part)
        sent += len(part)
        if progress is not None:
            progress(sent, len(file))


@dataclass(frozen=True)
class Steps:
    """Steps that a session is to take, as of `Session.step`."""

    session: Session
    count: int = 1
    motions: Sequence[Mapping[ToolRef, Motion | ArrayLike]] = ()

    def take(self) -> StepResult:
        """Takes them."""
        return self.session.step(self.count, self.motions)


def step_together(transport: Transport, wanted: Sequence[Steps]) -> list[StepResult]:
    """Steps sessions of one server at once."""
    results: list[StepResult] = []
    for first, end in _calls([each.count for each in wanted]):
        asked = [(each, each.session._inputs(each.motions)) for each in wanted[first:end]]
        request = pb.StepSessionsRequest()
        for each, inputs in asked:
            request.sessions.append(each.session._request(each.count, inputs))
        answer = transport.call("SessionService/StepSessions", request, pb.StepSessionsResponse)
        for (each, inputs), stepped in zip(asked, answer.sessions, strict=True):
            results.append(each.session._stepped(inputs, stepped))
    return results


def _calls(counts: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Ranges of sessions with as many steps as one call takes."""
    first, steps = 0, 0
    for at, count in enumerate(counts):
        if steps + count > _STEPS_TOGETHER and at > first:
            yield first, at
            first, steps = at, 0
        steps += count
    if first < len(counts):
        yield first, len(counts)


def _motion(motion: Motion | ArrayLike) -> Motion:
    if motion is None or isinstance(motion, Placement):
        return motion
    return Placement(poses_array(motion, "motions")[0])
