"""What a server refuses, as exceptions that carry the field and the limit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any

import grpc
from google.rpc import error_details_pb2, status_pb2


class KerfError(Exception):
    """Anything that this package raises by itself.

    Attributes:
        field: Path of the field that is at fault, as on the wire (`"inputs[0].motions[0].pose.pose.position_m"`);
            empty where no field is.
        limit: The limit that was not kept: a setting of the server (`"max_sessions"`), or words for people
            (`"must be 1 to 1000"`); empty where there is none.
    """

    def __init__(self, message: str, *, field: str = "", limit: str = "") -> None:
        super().__init__(message)
        self.field = field
        self.limit = limit


class InvalidArgumentError(KerfError, ValueError):
    """A request that cannot be served as it is; `field` says where."""


class NotFoundError(KerfError, LookupError):
    """No such session, scene, tool, checkpoint or viewer."""


class MovedError(NotFoundError):
    """The session goes on at another server.

    Attributes:
        to: Its address.
    """

    def __init__(self, message: str, *, to: str) -> None:
        super().__init__(message)
        self.to = to


class ResourceExhaustedError(KerfError):
    """The server has no room; `limit` names the setting."""


class FailedPreconditionError(KerfError):
    """Not now: a tool is driven by somebody else, a session has failed, or the dial cannot be set so.

    Nor here: in a process that was forked, by the connection of its parent.
    """


class StepsEndedError(KerfError):
    """Steps were ended by a pause, a resume, a reset or a way back before all were taken."""


class AccessDeniedError(KerfError, PermissionError):
    """The server asks for a token, takes another one than was given, or one that is good for more."""


class UnavailableError(KerfError, ConnectionError):
    """The server cannot be reached, or goes down."""


class DeadlineError(KerfError, TimeoutError):
    """No answer came in time."""


class PoseRejectedError(KerfError, ValueError):
    """A pose that was sent to a session that steps by itself was not accepted."""


class ReplicaError(KerfError):
    """A message of the view stream that cannot be applied, or a surface that is not the server's."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Words that follow a name that is not known, where one that is known is like it; else nothing."""
    likely = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {likely[0]!r}?" if likely else ""


_BY_CODE: dict[grpc.StatusCode, type[KerfError]] = {
    grpc.StatusCode.INVALID_ARGUMENT: InvalidArgumentError,
    grpc.StatusCode.NOT_FOUND: NotFoundError,
    grpc.StatusCode.RESOURCE_EXHAUSTED: ResourceExhaustedError,
    grpc.StatusCode.FAILED_PRECONDITION: FailedPreconditionError,
    grpc.StatusCode.UNAUTHENTICATED: AccessDeniedError,
    grpc.StatusCode.PERMISSION_DENIED: AccessDeniedError,
    grpc.StatusCode.ABORTED: StepsEndedError,
    grpc.StatusCode.UNAVAILABLE: UnavailableError,
    grpc.StatusCode.DEADLINE_EXCEEDED: DeadlineError,
}


def of_rpc(error: Any) -> KerfError:  # noqa: ANN401
    """The exception that says what a failed call says."""
    message = error.details() or str(error.code())
    metadata = error.trailing_metadata() or ()
    for key, value in metadata:
        if key == "kerf-moved-to":
            return MovedError(message, to=value)
    field, limit = _details(metadata)
    if field and not limit:
        # The rest of the words: `steps = 0: must be 1 to 1000`.
        limit = re.sub(r"^(\s=\s[^:]*)?:\s*", "", message.removeprefix(field))
    return _BY_CODE.get(error.code(), KerfError)(message, field=field, limit=limit)


def _details(metadata: Any) -> tuple[str, str]:  # noqa: ANN401
    field = limit = ""
    for key, value in metadata:
        if key != "grpc-status-details-bin":
            continue
        bad_request, quota = error_details_pb2.BadRequest(), error_details_pb2.QuotaFailure()
        for detail in status_pb2.Status.FromString(value).details:
            if detail.Unpack(bad_request):
                field = bad_request.field_violations[0].field
            elif detail.Unpack(quota):
                limit = quota.violations[0].subject
    return field, limit
