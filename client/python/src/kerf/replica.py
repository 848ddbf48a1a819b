"""A copy of what a session shows: built from a keyframe, kept by patches, moved by states.

Everything that comes in is checked before it is used, and after each change of structure the surface's hash is compared
with the server's. A refused message leaves the replica as it was, but for a patch that fails half-way or leads to
another hash: then the structure is dropped, and a keyframe has to come.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from google.protobuf.message import DecodeError

from kerf import surface_hash
from kerf.body import Body, Moved, Surface
from kerf.errors import ReplicaError
from kerf.v1 import view_pb2 as pb

__all__ = ["Assembler", "Replica", "Surface"]

T = TypeVar("T")

#: What a whole message may hold, bytes: the largest that the server sends.
_MAX_MESSAGE_BYTES = 64 << 20


class Assembler:
    """Puts messages together that were too large for one."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._remaining = 0

    def take(self, message: pb.ViewResponse) -> pb.ViewResponse | None:
        """Takes the stream's next message; answers with one that is whole, once there is one."""
        if message.WhichOneof("message") != "fragment":
            if self._remaining:
                raise self._failed()
            return message
        fragment = message.fragment
        follows = not self._remaining or fragment.remaining + 1 == self._remaining
        if not follows or len(self._data) + len(fragment.data) > _MAX_MESSAGE_BYTES:
            raise self._failed()
        self._data += fragment.data
        self._remaining = fragment.remaining
        if self._remaining:
            return None
        try:
            whole = pb.ViewResponse.FromString(bytes(self._data))
        except DecodeError as error:
            raise self._failed() from error
        self._data.clear()
        return whole

    def _failed(self) -> ReplicaError:
        self._data.clear()
        self._remaining = 0
        return ReplicaError("fragments that do not make a message", field="fragment")


class Replica:
    """The structure and state of every object of a session."""

    def __init__(self, object_names: Sequence[str]) -> None:
        self._object_names = tuple(object_names)
        self._bodies: list[Body] | None = None
        self._has_plain_vertices = False
        #: Version of the structure.
        self.topology_version = 0
        #: Hash of the surface; `None` while there is no structure, meaningless for plain vertices.
        self.surface_hash: int | None = None
        #: Steps taken when the state was read; `None` until a state has come for the structure as it is.
        self.step: int | None = None

    def apply(self, message: pb.ViewResponse) -> None:
        """Applies what a whole message says of structure and state; others change nothing."""
        kind = message.WhichOneof("message")
        if kind == "keyframe":
            self._apply_keyframe(message.keyframe)
        elif kind == "patch":
            self._apply_patch(message.patch)
        elif kind == "state":
            self._apply_state(message.state)

    def surfaces(self) -> list[Surface]:
        """The surface of each object where it is now.

        Raises:
            ReplicaError: No state has come yet for the structure as it is.
        """
        if self._bodies is None or self.step is None:
            raise ReplicaError("no state yet of the structure as it is")
        named = zip(self._object_names, self._bodies, strict=True)
        return [body.surface(name, self.step, self.topology_version) for name, body in named]

    def _apply_keyframe(self, keyframe: pb.Keyframe) -> None:
        self._has_plain_vertices = keyframe.encoding == pb.SURFACE_ENCODING_VERTICES
        bodies = [Body(has_plain_vertices=self._has_plain_vertices) for _ in keyframe.bodies]
        self._each(bodies, keyframe.bodies, "keyframe", Body.change)
        self._take(bodies, keyframe.topology_version, keyframe.surface_hash)

    def _apply_patch(self, patch: pb.TopologyPatch) -> None:
        bodies = self._bodies
        if bodies is None:
            raise ReplicaError("a patch came before a keyframe")
        if patch.from_version != self.topology_version or patch.to_version <= patch.from_version:
            words = f"a patch leads from version {patch.from_version} to {patch.to_version}"
            have = str(self.topology_version)
            raise ReplicaError(f"{words}, the replica is at {have}", field="patch.from_version", limit=have)
        # Taken out, so that a patch that fails half-way leaves nothing half-changed behind.
        self._drop()
        self._each(bodies, patch.bodies, "patch", Body.change)
        self._take(bodies, patch.to_version, patch.surface_hash)

    def _apply_state(self, state: pb.State) -> None:
        if self._bodies is None or state.topology_version != self.topology_version:
            # Of a structure that is not here: it is dropped, as the protocol says.
            return
        moved: list[Moved] = []

        def read(body: Body, of: pb.BodyState) -> None:
            moved.append(body.read_state(of, state.has_reference))

        self._each(self._bodies, state.bodies, "state", read)
        # Only once all of it is known to fit.
        for body, to in zip(self._bodies, moved, strict=True):
            body.displace(to)
        self.step = state.step

    def _take(self, bodies: list[Body], version: int, expected: int) -> None:
        computed = surface_hash.of_surface([body.hash_sum for body in bodies])
        if computed != expected and not self._has_plain_vertices:
            self._drop()
            words = f"at version {version} is {computed:016x}, the server says {expected:016x}"
            raise ReplicaError(f"the surface hash {words}", field="surface_hash", limit=f"{expected:016x}")
        self._bodies, self.topology_version, self.surface_hash, self.step = bodies, version, computed, None

    def _drop(self) -> None:
        self._bodies = self.surface_hash = self.step = None

    def _each(self, bodies: list[Body], parts: Sequence[T], name: str, act: Callable[[Body, T], None]) -> None:
        if len(parts) != len(self._object_names):
            limit = f"{len(self._object_names)} entries"
            raise ReplicaError(f"{name}.bodies: {len(parts)} entries", field=f"{name}.bodies", limit=limit)
        for index, (body, part) in enumerate(zip(bodies, parts, strict=True)):
            try:
                act(body, part)
            except ReplicaError as error:
                path = f"{name}.bodies[{index}]"
                raise ReplicaError(f"{path}.{error}", field=f"{path}.{error.field}", limit=error.limit) from error
