"""Driving tools of a session that steps by itself, in real time."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kerf.errors import DeadlineError, KerfError, PoseRejectedError, UnavailableError
from kerf.model import ContactFlags, Floats, xyz
from kerf.motion import Placement, Track, poses_array, read_pose, write_pose
from kerf.rpc import PROTOCOL_VERSION, Following
from kerf.v1 import control_pb2 as pb

if TYPE_CHECKING:
    from typing import Self

#: How often `Control.play` sends a pose, Hz.
_POSE_RATE_HZ = 250.0
#: How long a server may take to grant tools.
_HELLO_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class Contact:
    """What a tool feels after a step."""

    tool: int
    step: int
    sim_time_s: float
    #: On the tool, scene frame.
    force_n: Floats
    #: On the tool about its reference point, scene frame.
    torque_nm: Floats
    cutting_length_m: float
    flags: ContactFlags
    #: Where the tool was, its reference point in metres, then a quaternion x, y, z, w; NaN while it is lifted. (7,)
    pose: Floats


class Control:
    """Drives tools, and reads what they feel. Of poses and contacts the newest wins; nothing queues.

    A context manager: at its end the tools are lifted and free for others.
    """

    def __init__(self, transport: Following, session_id: str, tools: Sequence[int], contact_rate_hz: float) -> None:
        hello = pb.ClientHello(
            protocol_version=PROTOCOL_VERSION,
            session_id=session_id,
            tool_ids=list(tools),
            contact_rate_hz=contact_rate_hz,
            # A contact has nothing of them, and they take much of a step.
            without_models=True,
        )
        self._outgoing: queue.SimpleQueue[pb.ControlRequest | None] = queue.SimpleQueue()
        self._outgoing.put(pb.ControlRequest(hello=hello))
        self._seq = 0
        self._news = threading.Condition()
        self._greeted = False
        self._contacts: dict[int, Contact] = {}
        self._told: dict[int, int] = {}
        self._error: KerfError | None = None
        self._ended = False
        self._stream = transport.converse(
            "ControlService/Control", self._requests(), pb.ControlRequest(), pb.ControlResponse
        )
        self._thread = threading.Thread(target=self._read, name=f"kerf-control-{session_id}", daemon=True)
        self._thread.start()
        with self._news:
            self._news.wait_for(lambda: self._greeted or self._error or self._ended, timeout=_HELLO_TIMEOUT_S)
            self._raise_error()
            if not self._greeted:
                raise DeadlineError(f"no ServerHello within {_HELLO_TIMEOUT_S} s")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, pose: ArrayLike, *, tool: int = 0, opening: float = 1.0) -> None:
        """Says where a tool is now.

        Raises:
            PoseRejectedError: An earlier pose was not accepted.
        """
        with self._news:
            self._raise_error()
            self._seq += 1
            placement = Placement(poses_array(pose, "pose")[0], opening)
            request = pb.ControlRequest(pose=pb.ToolPose(seq=self._seq, client_ns=time.monotonic_ns()))
            write_pose(request.pose, tool, placement)
            self._outgoing.put(request)

    def lift(self, tool: int = 0) -> None:
        """Takes a tool out of the scene until its next pose."""
        self._outgoing.put(pb.ControlRequest(lift=pb.LiftTool(tool_id=tool)))

    def contact(self, tool: int = 0, timeout_s: float = 1.0) -> Contact:
        """The newest contact of a tool that this has not answered with before.

        Raises:
            DeadlineError: None came in time, as while the session stands.
        """
        with self._news:
            new = self._news.wait_for(lambda: self._is_new(tool) or self._error or self._ended, timeout=timeout_s)
            self._raise_error()
            if not new or not self._is_new(tool):
                raise DeadlineError(f"no contact of tool {tool} within {timeout_s} s", field="tool")
            contact = self._contacts[tool]
            self._told[tool] = contact.step
            return contact

    def play(
        self, times_s: ArrayLike, poses: ArrayLike, *, tool: int = 0, openings: ArrayLike | None = None
    ) -> list[Contact]:
        """Moves a tool through poses in real time; the contacts that came meanwhile."""
        track = Track.of(times_s, poses, openings)
        contacts = []
        begin_s = time.monotonic()
        for now_s in np.arange(0.0, track.times_s[-1] + 1.0 / _POSE_RATE_HZ, 1.0 / _POSE_RATE_HZ):
            time.sleep(max(begin_s + now_s - time.monotonic(), 0.0))
            pose, opening = track.at(np.array([now_s]))
            self.send(pose[0], tool=tool, opening=float(opening[0]))
            with self._news:
                if self._is_new(tool):
                    contacts.append(self._contacts[tool])
                    self._told[tool] = self._contacts[tool].step
        return contacts

    def close(self) -> None:
        """Gives the tools back."""
        self._outgoing.put(None)
        self._stream.cancel()
        self._thread.join()

    def _requests(self) -> Iterator[pb.ControlRequest]:
        while (request := self._outgoing.get()) is not None:
            yield request

    def _is_new(self, tool: int) -> bool:
        contact = self._contacts.get(tool)
        return contact is not None and contact.step != self._told.get(tool)

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if self._ended:
            raise UnavailableError("the control stream has ended")

    def _read(self) -> None:
        try:
            for message in self._stream:
                with self._news:
                    self._take(message)
                    self._news.notify_all()
        except KerfError as error:
            with self._news:
                self._error = error
        finally:
            with self._news:
                self._ended = True
                self._news.notify_all()

    def _take(self, message: pb.ControlResponse) -> None:
        kind = message.WhichOneof("message")
        if kind == "hello":
            self._greeted = True
        elif kind == "contact":
            told = message.contact
            self._contacts[told.tool_id] = Contact(
                tool=told.tool_id,
                step=told.step,
                sim_time_s=told.sim_time_s,
                force_n=xyz(told.wrench.force_n),
                torque_nm=xyz(told.wrench.torque_nm),
                cutting_length_m=told.cutting_length_m,
                flags=ContactFlags(told.flags),
                pose=read_pose(told.reference) if told.HasField("reference") else np.full(7, np.nan),
            )
            self._outgoing.put(pb.ControlRequest(received=told.number))
        elif kind == "rejected":
            words = f"tool {message.rejected.tool_id}, {message.rejected.field}: {message.rejected.limit}"
            self._error = PoseRejectedError(words, field=message.rejected.field, limit=message.rejected.limit)
