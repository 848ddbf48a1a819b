"""A connection to a server: its scenes and its sessions."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal

from kerf.errors import InvalidArgumentError, KerfError
from kerf.making_bar import MakingBar
from kerf.model import Making, SceneInfo, SessionState, StepResult
from kerf.rpc import Transport, parts_of
from kerf.session import Session, Steps, step_together
from kerf.v1 import session_pb2 as pb

if TYPE_CHECKING:
    from typing import Self


class Client:
    """A connection to a server; a context manager."""

    def __init__(
        self,
        address: str = "127.0.0.1:50051",
        *,
        timeout_s: float = 60.0,
        token: str | None = None,
        ca_file: str | Path | None = None,
    ) -> None:
        """Connects.

        Args:
            address: Host and port; `https://` before them asks for TLS.
            timeout_s: What a call may take, s.
            token: What the server lets this client in by. Else it is read from the file that `KERF_TOKEN_FILE` names,
                or from `KERF_TOKEN`.
            ca_file: Certificates (PEM) of those who are trusted to sign the server's; asks for TLS. Else those of the
                file that `KERF_CA_FILE` names, or the system's.
        """
        self._transport = Transport(address, timeout_s, token=token, ca_file=ca_file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection. Sessions go on."""
        self._transport.close()

    def wait_until_ready(self, timeout_s: float = 10.0) -> None:
        """Waits for the server to listen."""
        self._transport.wait_until_ready(timeout_s)

    def scenes(self) -> list[SceneInfo]:
        """The scenes that can be created by name."""
        answer = self._transport.call("SessionService/ListScenes", pb.ListScenesRequest(), pb.ListScenesResponse)
        return [SceneInfo(scene.name, scene.description) for scene in answer.scenes]

    def scene_toml(self, scene_name: str) -> str:
        """The text of a scene, to be read, changed and given to `create_session`."""
        request = pb.GetSceneRequest(scene_name=scene_name)
        return self._transport.call("SessionService/GetScene", request, pb.GetSceneResponse).scene_toml

    def sessions(self) -> dict[str, SessionState]:
        """What the sessions of the server are doing, by their ids."""
        return {session.session_id: SessionState(session.state) for session in self._listed().sessions}

    def expected_sessions(self) -> int:
        """How many sessions of the server before are not back yet: calls to them raise `UnavailableError`."""
        return self._listed().server.expected_sessions

    def server_version(self) -> str:
        """The version of the server's program."""
        return self._listed().server.version

    def _listed(self) -> pb.ListSessionsResponse:
        return self._transport.call("SessionService/ListSessions", pb.ListSessionsRequest(), pb.ListSessionsResponse)

    def create_session(
        self,
        scene_name: str | None = None,
        *,
        path: str | Path | None = None,
        toml: str | None = None,
        files: Mapping[str, bytes] | None = None,
        real_time: bool = False,
        level: int | None = None,
        budget_ms: float | None = None,
        max_error: float | None = None,
        step_rate_hz: float | None = None,
        private: bool = False,
        progress: Callable[[int, int], object] | None = None,
        making: Callable[[Making], object] | Literal["bar"] | None = "bar",
    ) -> Session:
        """Builds a scene, named, in a file, or as text, and begins a session of it.

        Args:
            scene_name: One of `scenes`.
            path: A scene file; the meshes, label maps and edges that it names are read from beside it.
            toml: The text of a scene.
            files: Meshes, label maps and edges that the text names.
            real_time: It steps by itself, at the scene's rate. Else it stands, and is stepped by `Session.step`.
            level: Level of every object, 0 (exact) to 4.
            budget_ms: Or the most exact measured setting whose steps take at most this long in the median.
            max_error: Or the cheapest measured setting that errs by at most this.
            step_rate_hz: Steps per simulated second; the scene's unless it is given.
            private: Nobody gets to know of it but clients with the same token, and operators.
            progress: Called with the bytes of the files that were sent and those that there are, part by part, from
                another thread.
            making: Called with how far the scene is, as it changes, before this returns. `"bar"`: a bar tells it on
                `sys.stderr` where that is a terminal. `None`: nothing does.
        """
        if sum(given is not None for given in (scene_name, path, toml)) != 1:
            raise InvalidArgumentError("give one of scene_name, path and toml", field="scene", limit="one of three")
        if path is not None:
            toml, files = read_scene(path)
        sent = files or {}
        request = pb.CreateSessionRequest(
            scene_name=scene_name,
            scene_toml=toml,
            start_paused=not real_time,
            level=level,
            budget_ms=budget_ms,
            max_error=max_error,
            step_rate_hz=step_rate_hz,
            private=private,
        )
        created: pb.CreateSessionResponse | pb.UploadSceneResponse
        if making == "bar":
            making = MakingBar.on_terminal()
        if making is not None:
            request.upload_id = self._send_files(sent, progress)
            created = self._make(request, making)
        elif sent:
            parts = _scene_in_parts(request, sent, progress)
            method = "SessionService/UploadScene"
            created = self._transport.send(method, parts, pb.UploadSceneRequest, pb.UploadSceneResponse)
        else:
            created = self._transport.call("SessionService/CreateSession", request, pb.CreateSessionResponse)
        return Session(self._transport, created.session, warnings=created.warnings, files=sent)

    def load(self, file: str | Path, scene_name: str | None = None, **options: Any) -> Session:  # noqa: ANN401
        """Begins a session that goes on from a file of `Session.save`, to the same bits.

        Args:
            file: The state. It does not have the scene, which is named as for `create_session`.
            scene_name: One of `scenes`.
            options: As of `create_session`: `path`, `toml` and `files` of the scene, its `level`, `step_rate_hz`.

        Raises:
            InvalidArgumentError: The file is of another scene, step rate or level, or of another version.
        """
        session = self.create_session(scene_name, **options)
        try:
            session.load(file)
        except KerfError:
            session.close()
            raise
        return session

    def _make(self, request: pb.CreateSessionRequest, making: Callable[[Making], object]) -> pb.CreateSessionResponse:
        asked, timeout_s = pb.MakeSessionRequest(request=request), self._transport.timeout_s
        try:
            for told in self._transport.read("SessionService/MakeSession", asked, pb.MakeSessionResponse, timeout_s):
                if told.HasField("created"):
                    return told.created
                making(Making.of(told.progress))
        finally:
            if isinstance(making, MakingBar):
                making.clear()
        raise KerfError("the server ended the call without a session")

    def _send_files(self, files: Mapping[str, bytes], progress: Callable[[int, int], object] | None) -> str:
        """The name of the upload; none without files."""
        upload_id = ""
        for part in _file_parts(files, progress):
            request = pb.SendSceneFileRequest(upload_id=upload_id, file_name=part.file_name, data=part.data)
            answer = self._transport.call("SessionService/SendSceneFile", request, pb.SendSceneFileResponse)
            upload_id = answer.upload_id
        return upload_id

    def join_session(self, session_id: str) -> Session:
        """A session that is there already; it is not closed at the end of a `with`."""
        request = pb.DescribeSessionRequest(session_id=session_id)
        answer = self._transport.call("SessionService/DescribeSession", request, pb.DescribeSessionResponse)
        return Session(self._transport, answer.session, owned=False)

    def step_together(self, wanted: Sequence[Steps]) -> list[StepResult]:
        """Steps many sessions at once, each as its `step` does; what each of them led to, in order.

        They step side by side on as many cores as the server has. A call takes 10,000 steps together, and more than
        these go in several, one after the other. What is wrong with one session is said before any of its call moves.
        """
        return step_together(self._transport, wanted)


def read_scene(path: str | Path) -> tuple[str, dict[str, bytes]]:
    """The text of a scene file, and the meshes, label maps and edges that it names, from beside it."""
    toml = Path(path).read_text(encoding="utf-8")
    return toml, {name: (Path(path).parent / name).read_bytes() for name in _files_of(tomllib.loads(toml))}


def _scene_in_parts(
    request: pb.CreateSessionRequest, files: Mapping[str, bytes], progress: Callable[[int, int], object] | None
) -> Iterator[pb.UploadSceneRequest]:
    """What is asked for, then the files."""
    yield pb.UploadSceneRequest(request=request)
    yield from _file_parts(files, progress)


def _file_parts(
    files: Mapping[str, bytes], progress: Callable[[int, int], object] | None
) -> Iterator[pb.UploadSceneRequest]:
    """Each file by its name, and in parts."""
    sent, total = 0, sum(map(len, files.values()))
    for name, data in files.items():
        yield pb.UploadSceneRequest(file_name=name)
        for part in parts_of(data):
            yield pb.UploadSceneRequest(data=part)
            sent += len(part)
            if progress is not None:
                progress(sent, total)


def _files_of(value: Any) -> Iterator[str]:  # noqa: ANN401
    """The files that a scene names."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key == "file" and isinstance(inner, str):
                yield inner
            else:
                yield from _files_of(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _files_of(inner)
