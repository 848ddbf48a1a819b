"""Following the surface of a session."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from kerf.errors import (
    DeadlineError,
    KerfError,
    MovedError,
    NotFoundError,
    ReplicaError,
    UnavailableError,
    did_you_mean,
)
from kerf.replica import Assembler, Replica, Surface
from kerf.rpc import PROTOCOL_VERSION, Following, Stream
from kerf.v1 import view_pb2 as pb

if TYPE_CHECKING:
    from typing import Self

    from kerf.model import SceneObject


#: So long a view looks for a server that it has lost, s, and so often.
_LOOKS_FOR_S = 30.0
_LOOKS_EVERY_S = 0.2


class View:
    """Keeps a replica of what the session shows, up to date in a thread of its own; a context manager."""

    def __init__(self, transport: Following, session_id: str, objects: Sequence[SceneObject], rate_hz: float) -> None:
        self._transport = transport
        self._objects = tuple(objects)
        self._replica = Replica([known.name for known in objects])
        self._viewer = ""
        self._news = threading.Condition()
        self._error: KerfError | None = None
        self._ended = False
        self._request = pb.ViewRequest(protocol_version=PROTOCOL_VERSION, session_id=session_id, rate_hz=rate_hz)
        self._closed = False
        self._heard_s = time.monotonic()
        self._stream = self._open()
        self._thread = threading.Thread(target=self._read, name=f"kerf-view-{session_id}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def surfaces(self, step: int = 0, timeout_s: float = 10.0) -> list[Surface]:
        """The surface of each object, as of this step or a later one.

        Raises:
            DeadlineError: No such state came in time.
            ReplicaError: What came cannot be applied, or its surface is not the server's.
        """
        with self._news:
            self._wait(step, timeout_s)
            surfaces = self._replica.surfaces()
        looks = [(known.material_names, known.material_colors) for known in self._objects]
        return [
            replace(surface, material_names=names, material_colors=colors)
            for surface, (names, colors) in zip(surfaces, looks, strict=True)
        ]

    def surface(self, name: str | None = None, step: int = 0, timeout_s: float = 10.0) -> Surface:
        """The surface of one object, by default the first."""
        surfaces = self.surfaces(step, timeout_s)
        if name is None:
            return surfaces[0]
        named = [surface for surface in surfaces if surface.object_name == name]
        if not named:
            known = [surface.object_name for surface in surfaces]
            words = f"no object {name!r} among {', '.join(known)}{did_you_mean(name, known)}"
            raise NotFoundError(words, field="name", limit=f"one of {', '.join(known)}")
        return named[0]

    def surface_hash(self, step: int = 0, timeout_s: float = 10.0) -> int:
        """Hash of the surface's structure, which is the server's: this is checked whenever it changes."""
        with self._news:
            self._wait(step, timeout_s)
            return self._replica.surface_hash or 0

    def close(self) -> None:
        """Stops following."""
        with self._news:
            self._closed = True
            self._stream.cancel()
        self._thread.join()

    def _wait(self, step: int, timeout_s: float) -> None:
        def is_there() -> bool:
            return self._replica.step is not None and self._replica.step >= step

        self._news.wait_for(lambda: is_there() or self._error is not None or self._ended, timeout=timeout_s)
        if self._error is not None:
            raise self._error
        if is_there():
            return
        if self._ended:
            raise UnavailableError("the view has ended")
        raise DeadlineError(f"no state of step {step} or later within {timeout_s} s", field="step")

    def _open(self) -> Stream[pb.ViewResponse]:
        return self._transport.read("ViewService/View", self._request, pb.ViewResponse)

    def _read(self) -> None:
        try:
            while not self._ended:
                self._follow()
        except KerfError as error:
            with self._news:
                self._error = error
        finally:
            with self._news:
                self._ended = True
                self._news.notify_all()

    def _follow(self) -> None:
        """Reads the stream to its end; where the session has moved or the connection broke another one begins."""
        assembler = Assembler()
        try:
            for part in self._stream:
                message = assembler.take(part)
                if message is None:
                    continue
                if message.WhichOneof("message") == "hello":
                    self._viewer = message.hello.viewer
                self._heard_s = time.monotonic()
                with self._news:
                    self._replica.apply(message)
                    self._news.notify_all()
                if message.number:
                    self._acknowledge(message.number)
            self._ended = True
        except MovedError:
            self._begin_again()
        except UnavailableError:
            # A server that keeps journals is started anew, and brings the session back.
            if self._transport.is_closed or time.monotonic() > self._heard_s + _LOOKS_FOR_S:
                raise
            time.sleep(_LOOKS_EVERY_S)
            self._begin_again()

    def _begin_again(self) -> None:
        with self._news:
            self._ended = self._closed
            if not self._closed:
                self._stream = self._open()

    def _acknowledge(self, number: int) -> None:
        try:
            request = pb.AcknowledgeRequest(viewer=self._viewer, number=number)
            self._transport.call("ViewService/Acknowledge", request, pb.AcknowledgeResponse)
        except NotFoundError:
            # The stream has ended meanwhile, as the reading of it will say.
            pass


__all__ = ["ReplicaError", "Surface", "View"]
