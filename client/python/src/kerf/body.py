"""One object of a view: its lattice, the surface bound to it, and where the nodes are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kerf import integers, surface_file, surface_hash
from kerf.errors import ReplicaError
from kerf.surface_mesh import F32, U32, SurfaceMesh
from kerf.v1 import view_pb2 as pb

#: Most node slots of an object: a state has to carry 12 bytes for each, and has 64 MiB at most.
_MAX_NODES = (64 << 20) // 12


class Table:
    """Rows by ascending id; a change adds rows and replaces some, and nothing is ever removed."""

    def __init__(self, width: int, dtype: type[np.generic]) -> None:
        self.ids: U32 = np.zeros(0, dtype=np.uint32)
        self.rows: NDArray[Any] = np.zeros((0, width), dtype=dtype)

    def find(self, ids: U32, field: str) -> NDArray[np.intp]:
        """Places of these ids.

        Raises:
            ReplicaError: One of them is not there.
        """
        places, known = self._look(ids)
        if not known.all():
            raise ReplicaError(f"{field}: id {ids[~known][0]} does not exist", field=field, limit="ids that exist")
        return places

    def known(self, ids: U32) -> tuple[U32, NDArray[Any]]:
        """Those of these ids that there are, and their rows."""
        places, known = self._look(ids)
        return ids[known], self.rows[places[known]]

    def upsert(self, ids: U32, rows: NDArray[Any]) -> None:
        """Adds rows, and replaces those of ids that are there."""
        places, known = self._look(ids)
        self.rows[places[known]] = rows[known]
        self.ids = np.insert(self.ids, places[~known], ids[~known])
        self.rows = np.insert(self.rows, places[~known], rows[~known], axis=0)

    def remove(self, ids: U32) -> None:
        """Takes rows away, where there are any of these ids."""
        stays = ~np.isin(self.ids, ids)
        self.ids, self.rows = self.ids[stays], self.rows[stays]

    def _look(self, ids: U32) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        places = np.searchsorted(self.ids, ids)
        if not len(self.ids):
            return places, np.zeros(len(ids), dtype=bool)
        return places, (places < len(self.ids)) & (self.ids[np.minimum(places, len(self.ids) - 1)] == ids)


@dataclass(frozen=True)
class Surface(SurfaceMesh):
    """The surface of an object where it is after a step. N vertices, M quads."""

    def save(self, path: str | Path, *, pieces: bool = False) -> list[Path]:
        """Writes the surface to a file, by its ending: `.stl`, `.ply`, `.obj`, `.vtu` or `.glb`.

        With `pieces` each closed piece is a file of its own, the largest `x-1.stl`, the next `x-2.stl`.
        Answers with the files.

        All are of metres in the scene frame. A `.glb` has a mesh for each piece, with a primitive and a material for
        each region, and lines where skin and cuts meet. A `.vtu` says of each triangle which piece it is of and whether
        it is a wall of a cut. In a `.stl` walls of cuts are moved into their body by 0.1 µm, so that those of a shut
        cut stay apart. All but `.glb` need `pip install kerf[mesh]`.
        """
        return surface_file.save(self, Path(path), pieces=pieces)


@dataclass(frozen=True)
class Moved:
    """What a state says of an object."""

    reference: NDArray[np.int64]
    displacement_m: F32
    adapted_ids: U32
    adapted_m: F32


class Body:
    """Checked as it comes in, so that positions can be evaluated without looking again."""

    def __init__(self, *, has_plain_vertices: bool = False) -> None:
        #: Vertices are nodes themselves.
        self._has_plain_vertices = has_plain_vertices
        self._rest_m: F32 = np.zeros((0, 3), dtype=np.float32)
        self._is_node: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._displacement_m: F32 = np.zeros((0, 3), dtype=np.float32)
        self._elements = Table(8, np.uint32)
        self._vertices = Table(1, np.uint32)
        self._local = Table(3, np.float32)
        self._materials = Table(1, np.uint32)
        # Weights of the displacements of vertices beside what is held.
        self._held = Table(8, np.float32)
        self._quads = Table(4, np.uint32)
        # Displacements of the reference that those of states are differences to, in quanta.
        self._reference: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._quantum_m = 0.0
        self._adapted_ids: U32 = np.zeros(0, dtype=np.uint32)
        self._adapted_m: F32 = np.zeros((0, 3), dtype=np.float32)
        #: Sum of the hashes of the vertices, weights and quads, kept as they come.
        self.hash_sum = 0

    def change(self, change: pb.BodyStructure) -> None:
        """Applies what a keyframe (to an empty body) or a patch says. After an error the body is not to be used."""
        if change.quantum_m:
            self._quantum_m = change.quantum_m
        if not 0.0 < self._quantum_m < np.inf:
            raise ReplicaError(f"quantum_m: {self._quantum_m} m", field="quantum_m", limit="above 0")
        self._change_nodes(change)
        if self._has_plain_vertices:
            self._change_plain_vertices(change)
        else:
            self._change_elements(change)
            self._change_vertices(change)
        self._change_quads(change)

    def read_state(self, state: pb.BodyState, has_reference: bool) -> Moved:
        """What a state says of the object, for `displace`; whether it brings a reference."""
        numbers = 3 * len(self._rest_m)
        reference = self._reference
        if has_reference:
            given = integers.decode("reference", state.reference, numbers)
            reference = np.concatenate([given, np.zeros(numbers - len(given), dtype=np.int64)])
        displacements = _exactly("displacements", state.displacements, numbers)
        adapted_ids = np.cumsum(integers.decode("adapted_ids", state.adapted_ids, len(self._vertices.ids)))
        if (np.diff(adapted_ids) <= 0).any():
            raise ReplicaError("adapted_ids: ids do not ascend", field="adapted_ids", limit="ascending")
        self._vertices.find(adapted_ids.astype(np.uint32), "adapted_ids")
        offsets = _exactly("adapted_offsets", state.adapted_offsets, 3 * len(adapted_ids))
        return Moved(
            reference=reference,
            displacement_m=self._lengths_m(reference + displacements),
            adapted_ids=adapted_ids.astype(np.uint32),
            adapted_m=self._lengths_m(offsets),
        )

    def displace(self, moved: Moved) -> None:
        """Moves the nodes."""
        self._reference, self._displacement_m = moved.reference, moved.displacement_m
        self._adapted_ids, self._adapted_m = moved.adapted_ids, moved.adapted_m

    def _lengths_m(self, quanta: NDArray[np.int64]) -> F32:
        return (quanta * self._quantum_m).astype(np.float32).reshape(-1, 3)

    def surface(self, object_name: str, step: int, topology_version: int) -> Surface:
        """Where the surface is now."""
        ids, quad_ids = self._vertices.ids, self._quads.ids
        rest_m, moved_m = self._plain() if self._has_plain_vertices else self._interpolated()
        vertices_m = rest_m + moved_m
        vertices_m[np.searchsorted(ids, self._adapted_ids)] += self._adapted_m
        quads = np.searchsorted(ids, self._quads.rows.astype(np.uint32)).astype(np.int64)
        return Surface(
            object_name=object_name,
            vertices_m=vertices_m,
            quads=quads,
            triangles=quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3),
            # The other side of the link exists only where a blade parted it.
            is_cut=np.isin(quad_ids ^ np.uint32(1), quad_ids),
            materials=self._materials.rows[:, 0].astype(np.uint8),
            vertex_ids=ids,
            quad_ids=quad_ids,
            step=step,
            topology_version=topology_version,
        )

    def _plain(self) -> tuple[F32, F32]:
        """Rest positions and displacements of the vertices."""
        return self._rest_m[self._vertices.ids], self._displacement_m[self._vertices.ids]

    def _interpolated(self) -> tuple[F32, F32]:
        """The same, of vertices that move with elements."""
        elements = self._elements.find(self._vertices.rows[:, 0].astype(np.uint32), "vertex_elements")
        nodes = self._elements.rows[elements].astype(np.intp)
        weights = _corner_weights(self._local.rows.astype(np.float32))
        rest_m = _weighted(weights, self._rest_m[nodes])
        weights[np.searchsorted(self._vertices.ids, self._held.ids)] = self._held.rows
        return rest_m, _weighted(weights, self._displacement_m[nodes])

    def _change_nodes(self, change: pb.BodyStructure) -> None:
        have = len(self._rest_m)
        # Slots are never taken away: elements that nothing uses any more still refer to them.
        if not have <= change.node_count <= _MAX_NODES:
            limit = f"{have} to {_MAX_NODES}"
            raise ReplicaError(f"node_count: {change.node_count} is not {limit}", field="node_count", limit=limit)
        ids, rest_m = _rows("node_ids", change.node_ids, "node_rest_m", change.node_rest_m, 3, np.float32)
        if len(ids) and ids[-1] >= change.node_count:
            raise ReplicaError(f"node_ids: {ids[-1]}", field="node_ids", limit=f"below {change.node_count}")
        more = change.node_count - have
        self._rest_m = np.vstack([self._rest_m, np.zeros((more, 3), dtype=np.float32)])
        self._displacement_m = np.vstack([self._displacement_m, np.zeros((more, 3), dtype=np.float32)])
        self._reference = np.concatenate([self._reference, np.zeros(3 * more, dtype=np.int64)])
        self._is_node = np.concatenate([self._is_node, np.zeros(more, dtype=bool)])
        self._rest_m[ids], self._is_node[ids] = rest_m, True

    def _change_elements(self, change: pb.BodyStructure) -> None:
        ids, nodes = _rows("element_ids", change.element_ids, "element_nodes", change.element_nodes, 8, np.uint32)
        if not (nodes < len(self._is_node)).all() or not self._is_node[nodes].all():
            raise ReplicaError("element_nodes: a node does not exist", field="element_nodes", limit="ids that exist")
        self._elements.upsert(ids, nodes)

    def _change_plain_vertices(self, change: pb.BodyStructure) -> None:
        ids = np.array(change.node_ids, dtype=np.uint32)
        self._vertices.upsert(ids, ids[:, None])
        self._materials.upsert(ids, _materials(change, len(ids)))

    def _change_vertices(self, change: pb.BodyStructure) -> None:
        ids, local = _rows("vertex_ids", change.vertex_ids, "vertex_local", change.vertex_local, 3, np.float32)
        elements = _array("vertex_elements", change.vertex_elements, len(ids), 1, np.uint32)
        self._elements.find(elements[:, 0], "vertex_elements")
        before = self._sum_of_vertices(ids)
        self._vertices.upsert(ids, elements)
        self._local.upsert(ids, local)
        self._materials.upsert(ids, _materials(change, len(ids)))
        self.hash_sum = surface_hash.exchange(self.hash_sum, before, self._sum_of_vertices(ids))
        self._change_held(change)

    def _sum_of_vertices(self, ids: U32) -> int:
        """Sum of the hashes of those of these vertices that there are."""
        known, elements = self._vertices.known(ids)
        (_, local), (_, materials) = self._local.known(ids), self._materials.known(ids)
        return surface_hash.sum_of_vertices(known, elements[:, 0], local, materials[:, 0])

    def _change_held(self, change: pb.BodyStructure) -> None:
        held, of_each = change.held_vertex_ids, change.held_vertex_weights
        ids, weights = _rows("held_vertex_ids", held, "held_vertex_weights", of_each, 8, np.float32)
        self._vertices.find(ids, "held_vertex_ids")
        # A vertex that comes anew has the weights that come with it, or none.
        anew = np.union1d(np.array(change.vertex_ids, dtype=np.uint32), ids)
        before = surface_hash.sum_of_held(*self._held.known(anew))
        self.hash_sum = surface_hash.exchange(self.hash_sum, before, surface_hash.sum_of_held(ids, weights))
        self._held.remove(anew)
        self._held.upsert(ids, weights)

    def _change_quads(self, change: pb.BodyStructure) -> None:
        ids, corners = _rows("quad_ids", change.quad_ids, "quad_vertices", change.quad_vertices, 4, np.uint32)
        self._vertices.find(corners.reshape(-1), "quad_vertices")
        before = surface_hash.sum_of_quads(*self._quads.known(ids))
        after = surface_hash.sum_of_quads(ids, corners)
        self.hash_sum = surface_hash.exchange(self.hash_sum, before, after)
        self._quads.upsert(ids, corners)


def _materials(change: pb.BodyStructure, count: int) -> NDArray[Any]:
    if not change.vertex_materials:
        return np.zeros((count, 1), dtype=np.uint32)
    return _array("vertex_materials", change.vertex_materials, count, 1, np.uint32)


def _corner_weights(local: F32) -> F32:
    """Of the eight corners, corner c at (c & 1, c >> 1 & 1, c >> 2)."""
    corners = np.arange(8)
    bits = np.stack([corners & 1, corners >> 1 & 1, corners >> 2], axis=1).astype(bool)
    factors: F32 = np.where(bits, local[:, None, :], np.float32(1.0) - local[:, None, :])
    return np.asarray(factors.prod(axis=2))


def _weighted(weights: F32, at_corners: F32) -> F32:
    return np.asarray(np.einsum("vc,vcx->vx", weights, at_corners))


def _exactly(field: str, data: bytes, count: int) -> NDArray[np.int64]:
    values = integers.decode(field, data, count)
    if len(values) != count:
        raise ReplicaError(f"{field}: {len(values)} integers, {count} expected", field=field, limit=f"{count} integers")
    return values


def _array(field: str, values: Sequence[float], rows: int, width: int, dtype: type[np.generic]) -> NDArray[Any]:
    array = np.array(values, dtype=dtype)
    if len(array) != rows * width:
        limit = f"{rows * width} entries"
        raise ReplicaError(f"{field}: {len(array)} entries, {rows * width} expected", field=field, limit=limit)
    if not np.isfinite(array).all():
        raise ReplicaError(f"{field}: an entry is not finite", field=field, limit="finite")
    return array.reshape(rows, width)


def _rows(
    id_field: str, ids: Sequence[int], field: str, values: Sequence[float], width: int, dtype: type[np.generic]
) -> tuple[U32, NDArray[Any]]:
    """Ascending ids and the values that each of them has."""
    array = np.array(ids, dtype=np.uint32)
    if (array[1:] <= array[:-1]).any():
        raise ReplicaError(f"{id_field}: ids do not ascend", field=id_field, limit="ascending")
    return array, _array(field, values, len(array), width, dtype)
