"""Calls to a server: the one place that knows gRPC."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Generic, TypeVar

import grpc
from google.protobuf.message import Message

from kerf.errors import FailedPreconditionError, MovedError, UnavailableError, of_rpc

R = TypeVar("R", bound=Message)
Q = TypeVar("Q", bound=Message)

#: The version of the protocol that this package speaks.
PROTOCOL_VERSION = 3

#: What one message may hold, bytes; the server cuts larger ones of the view stream in parts.
_MAX_MESSAGE_BYTES = 64 << 20


#: Bytes of a part of a file: as the protocol advises.
_PART_BYTES = 256 << 10


def parts_of(data: bytes) -> Iterator[bytes]:
    """A file as it is sent, part by part."""
    for start in range(0, len(data), _PART_BYTES):
        yield data[start : start + _PART_BYTES]


class Transport:
    """A connection to a server. Calls are made by name, and errors come as `kerf.KerfError`."""

    def __init__(self, address: str, timeout_s: float, *, token: str | None, ca_file: str | Path | None) -> None:
        token, ca_file = token or _token_of_environment(), ca_file or os.environ.get("KERF_CA_FILE")
        is_secure = address.startswith("https://") or (ca_file is not None and "://" not in address)
        address = address.removeprefix("http://").removeprefix("https://")
        options = [
            ("grpc.max_receive_message_length", _MAX_MESSAGE_BYTES),
            ("grpc.max_send_message_length", _MAX_MESSAGE_BYTES),
            # Each connection of a program is its own, so that the end of one is the end of one.
            ("grpc.use_local_subchannel_pool", 1),
            # A server that is started anew is found within a moment.
            ("grpc.initial_reconnect_backoff_ms", 100),
            ("grpc.max_reconnect_backoff_ms", 1000),
        ]
        self.address = address
        self.timeout_s = timeout_s
        self._token, self._ca_file = token, ca_file
        if is_secure:
            certificates = None if ca_file is None else Path(ca_file).read_bytes()
            credentials = grpc.ssl_channel_credentials(root_certificates=certificates)
            self._channel = grpc.secure_channel(address, credentials, options)
        else:
            self._channel = grpc.insecure_channel(address, options)
        self._metadata = [("authorization", f"Bearer {token}")] if token else []
        self._calls: dict[str, Any] = {}
        self.is_closed = False
        self._process = os.getpid()

    def at(self, address: str) -> Transport:
        """A connection to another server, let in by the same."""
        return Transport(address, self.timeout_s, token=self._token, ca_file=self._ca_file)

    def wait_until_ready(self, timeout_s: float) -> None:
        """Waits for the server to listen."""
        self._refuse_after_fork()
        try:
            grpc.channel_ready_future(self._channel).result(timeout=timeout_s)
        except grpc.FutureTimeoutError as error:
            raise UnavailableError(f"no server at {self.address} within {timeout_s} s") from error

    def call(self, method: str, request: Message, response: type[R], timeout_s: float | None = None) -> R:
        """Calls `Service/Method` and waits for its answer."""
        try:
            answer: R = self._begin(
                "unary_unary", method, request, response, request, timeout=timeout_s or self.timeout_s
            )
        except grpc.RpcError as error:
            raise self._closed(error) or of_rpc(error) from error
        return answer

    def read(self, method: str, request: Message, response: type[R], timeout_s: float | None = None) -> Stream[R]:
        """Calls `Service/Method` and reads what comes until it ends, for as long as that takes by default."""
        return Stream(self._begin("unary_stream", method, request, response, request, timeout=timeout_s))

    def send(self, method: str, requests: Iterator[Q], request: type[Q], response: type[R]) -> R:
        """Calls `Service/Method`, sends requests one after another and waits for the answer."""
        try:
            answer: R = self._begin("stream_unary", method, request(), response, requests, timeout=self.timeout_s)
        except grpc.RpcError as error:
            raise self._closed(error) or of_rpc(error) from error
        return answer

    def converse(self, method: str, requests: Iterator[Message], request: Message, response: type[R]) -> Stream[R]:
        """Calls `Service/Method`, sends requests as they come and reads what comes until it ends."""
        return Stream(self._begin("stream_stream", method, request, response, requests))

    def close(self) -> None:
        """Ends all calls and the connection."""
        self.is_closed = True
        # A parent's is the parent's to end.
        if self._process == os.getpid():
            self._channel.close()

    def _begin(
        self,
        kind: str,
        method: str,
        request: Message,
        response: type[R],
        sent: object,
        timeout: float | None = None,
    ) -> Any:  # noqa: ANN401
        self._refuse_after_fork()
        try:
            return self._stub(kind, method, request, response)(sent, timeout=timeout, metadata=self._metadata)
        except ValueError as error:
            raise self._closed(error) or error from None

    def _refuse_after_fork(self) -> None:
        """Says so in a process that was forked: a call on its parent's connection may wait for ever."""
        if self._process != os.getpid():
            words = (
                f"the connection to {self.address} is of the process that this one was forked from: begin processes by "
                'context="spawn", as of multiprocessing and AsyncVectorEnv, or make the client in each of them'
            )
            raise FailedPreconditionError(words, limit="one process")

    def _closed(self, error: Exception) -> UnavailableError | None:
        """What to say in the place of gRPC's error where another thread has ended the connection."""
        if not self.is_closed:
            return None
        closed = UnavailableError(f"the connection to {self.address} was closed")
        closed.__cause__ = error
        return closed

    def _stub(self, kind: str, method: str, request: Message, response: type[R]) -> Any:  # noqa: ANN401
        if method not in self._calls:
            self._calls[method] = getattr(self._channel, kind)(
                f"/kerf.v1.{method}",
                request_serializer=type(request).SerializeToString,
                response_deserializer=response.FromString,
            )
        return self._calls[method]


class Following:
    """The calls of one session, which go where it has moved to."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    @property
    def is_closed(self) -> bool:
        """Whether its user has ended it."""
        return self._transport.is_closed

    def call(self, method: str, request: Message, response: type[R], timeout_s: float | None = None) -> R:
        """As of `Transport`."""
        return self._there(lambda: self._transport.call(method, request, response, timeout_s))

    def send(self, method: str, requests: Callable[[], Iterator[Q]], request: type[Q], response: type[R]) -> R:
        """As of `Transport`; requests are made anew where the session has moved."""
        return self._there(lambda: self._transport.send(method, requests(), request, response))

    def read(self, method: str, request: Message, response: type[R]) -> Stream[R]:
        """As of `Transport`. A stream ends with the move; the next one begins at the other server."""
        return self._transport.read(method, request, response).telling(self._follow)

    def converse(self, method: str, requests: Iterator[Message], request: Message, response: type[R]) -> Stream[R]:
        """As of `Transport`, and `read`."""
        return self._transport.converse(method, requests, request, response).telling(self._follow)

    def _there(self, call: Callable[[], R]) -> R:
        try:
            return call()
        except MovedError as error:
            self._follow(error)
            return call()

    def _follow(self, moved: MovedError) -> None:
        self._transport = self._transport.at(moved.to)


def _token_of_environment() -> str | None:
    """The token in the file that `KERF_TOKEN_FILE` names, or in `KERF_TOKEN`."""
    if file := os.environ.get("KERF_TOKEN_FILE"):
        return Path(file).read_text(encoding="utf-8").strip()
    return os.environ.get("KERF_TOKEN")


class Stream(Generic[R]):
    """Messages of a call, until it ends or is cancelled."""

    def __init__(self, call: Any) -> None:  # noqa: ANN401
        self._call = call
        self._moved: Callable[[MovedError], None] | None = None

    def telling(self, moved: Callable[[MovedError], None]) -> Stream[R]:
        """The same; where its session has moved this is told before the error is raised."""
        self._moved = moved
        return self

    def __iter__(self) -> Iterator[R]:
        try:
            yield from self._call
        except grpc.RpcError as error:
            if error.code() == grpc.StatusCode.CANCELLED:
                return
            said = of_rpc(error)
            if self._moved is not None and isinstance(said, MovedError):
                self._moved(said)
            raise said from error

    def cancel(self) -> None:
        """Ends the call from this side."""
        self._call.cancel()
