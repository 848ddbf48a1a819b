"""Surfaces as binary glTF 2.0, metres, +y up.

A piece is a node with a mesh of a primitive for each region, with a material of the region's name: one of a single
region is a closed primitive, those of several have the same vertices and are closed together. Skin and what a blade
laid open differ in the colours of their vertices. Where they meet there are lines, in a node below.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kerf.surface_mesh import SurfaceMesh

#: Linear colours of materials that state none, in the order in which they come.
_SKINS = (
    (0.50, 0.09, 0.06),
    (0.72, 0.48, 0.14),
    (0.22, 0.26, 0.52),
    (0.24, 0.42, 0.18),
    (0.44, 0.18, 0.42),
    (0.58, 0.56, 0.50),
)
#: How much of the way to white a wall of a cut is from the skin's colour.
_CUT_PALENESS = 0.4
#: What is left of the material's colour at vertices where both meet.
_SEAM_DARKNESS = 0.02

_LINES = 1
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _UNSIGNED_INT, _UNSIGNED_SHORT = 5126, 5125, 5123


def write(surface: SurfaceMesh, path: Path) -> None:
    """Writes a surface with all its pieces."""
    document = _Document()
    pieces = surface.pieces()
    for number, faces in enumerate(pieces, 1):
        name = surface.object_name if len(pieces) == 1 else f"{surface.object_name} {number}"
        document.add_piece(surface, faces, name)
    path.write_bytes(document.container())


class _Document:
    def __init__(self) -> None:
        self._binary = bytearray()
        self._lists: dict[str, list[Any]] = {
            name: [] for name in ("bufferViews", "accessors", "materials", "meshes", "nodes")
        }
        self._roots: list[int] = []

    def add_piece(self, surface: SurfaceMesh, faces: NDArray[np.intp], name: str) -> None:
        """Adds a piece, given by its triangles, and its seam."""
        used, local = np.unique(surface.triangles[faces], return_inverse=True)
        triangles, vertices_m = local.reshape(-1, 3), surface.vertices_m[used]
        is_cut, materials = surface.is_cut[faces // 2], _of_triangles(surface)[faces]
        seam = _seam(triangles, is_cut)
        on_skin, on_wall = (np.isin(np.arange(len(used)), triangles[side]) for side in (~is_cut, is_cut))
        shared = {"POSITION": self._positions(vertices_m), "NORMAL": self._vectors(normals(vertices_m, triangles))}
        primitives = []
        for material in np.unique(materials):
            name_of_region, skin = _look(surface, int(material))
            # The paler colour is the material's, since what a vertex has of it is at most all.
            cut = skin + _CUT_PALENESS * (1.0 - skin)
            colors = np.where(on_skin[:, None], skin / cut, 1.0)
            colors[on_skin & on_wall] = _SEAM_DARKNESS
            part = triangles[materials == material].astype("<u4").reshape(-1)
            primitive = {
                "attributes": {**shared, "COLOR_0": self._colors(colors)},
                "indices": self._accessor(part, _ELEMENT_ARRAY_BUFFER, _UNSIGNED_INT, "SCALAR"),
                "material": self._material(name_of_region, cut.tolist()),
            }
            primitives.append(primitive)
        node: dict[str, Any] = {"mesh": self._add("meshes", {"name": name, "primitives": primitives}), "name": name}
        if len(seam):
            node["children"] = [self._add_seam(vertices_m[seam].reshape(-1, 3), f"{name} seam")]
        self._roots.append(self._add("nodes", node))

    def container(self) -> bytes:
        """The header and the chunks, each padded to four bytes."""
        document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "Kerf"}, "scene": 0, "scenes": [{}]}
        if self._roots:
            document["scenes"] = [{"nodes": self._roots}]
            document["buffers"] = [{"byteLength": len(self._binary)}]
            document.update(self._lists)
        text = json.dumps(document, separators=(",", ":")).encode()
        chunks = [(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", bytes(self._binary))]
        body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks if data)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def _add_seam(self, ends_m: NDArray[Any], name: str) -> int:
        # With vertices of its own: some readers of lines look at no indices.
        lines = {
            "attributes": {"POSITION": self._positions(ends_m)},
            "mode": _LINES,
            "material": self._material("seam", [0.0, 0.0, 0.0]),
        }
        return self._add("nodes", {"mesh": self._add("meshes", {"name": name, "primitives": [lines]}), "name": name})

    def _material(self, name: str, color: list[float]) -> int:
        metallic = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.55}
        material = {"name": name, "pbrMetallicRoughness": metallic}
        known = self._lists["materials"]
        return known.index(material) if material in known else self._add("materials", material)

    def _positions(self, positions_m: NDArray[Any]) -> int:
        low, high = ([float(x) for x in bound] for bound in (positions_m.min(axis=0), positions_m.max(axis=0)))
        return self._vectors(positions_m, min=low, max=high)

    def _vectors(self, vectors: NDArray[Any], **more: Any) -> int:  # noqa: ANN401
        return self._accessor(vectors.astype("<f4"), _ARRAY_BUFFER, _FLOAT, "VEC3", **more)

    def _colors(self, rgb: NDArray[Any]) -> int:
        # Opaque, and of 16 bits: dark ones would show steps of 8.
        rgba = np.rint(np.column_stack([rgb, np.ones(len(rgb))]) * 65535.0).astype("<u2")
        return self._accessor(rgba, _ARRAY_BUFFER, _UNSIGNED_SHORT, "VEC4", normalized=True)

    def _accessor(self, values: NDArray[Any], target: int, component: int, kind: str, **more: Any) -> int:  # noqa: ANN401
        data = values.tobytes()
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data), "target": target}
        self._binary += data
        described = {"componentType": component, "count": len(values), "type": kind, **more}
        return self._add("accessors", {"bufferView": self._add("bufferViews", view), **described})

    def _add(self, name: str, entry: dict[str, Any]) -> int:
        self._lists[name].append(entry)
        return len(self._lists[name]) - 1


def _of_triangles(surface: SurfaceMesh) -> NDArray[np.uint8]:
    """Material of each triangle: that of most corners of its quad, of the first where several are of as many."""
    corners = surface.materials[surface.quads]
    counts = (corners[:, :, None] == corners[:, None, :]).sum(axis=2)
    most = np.take_along_axis(corners, counts.argmax(axis=1)[:, None], axis=1)[:, 0]
    return np.asarray(np.repeat(most, 2))


def _look(surface: SurfaceMesh, material: int) -> tuple[str, NDArray[Any]]:
    """Name of a material and linear colour of its skin."""
    known = material < len(surface.material_names)
    name = surface.material_names[material] if known else surface.object_name
    stated = surface.material_colors[material] if known else ""
    skin = [_linear(c) for c in bytes.fromhex(stated[1:])] if stated else _SKINS[material % len(_SKINS)]
    return name, np.array(skin)


def _linear(srgb: int) -> float:
    """A component of a colour in sRGB as glTF has it (IEC 61966-2-1)."""
    c = srgb / 255.0
    return c / 12.92 if c <= 0.04045 else float(((c + 0.055) / 1.055) ** 2.4)


def _seam(triangles: NDArray[np.int64], is_cut: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Edges at which skin and walls of cuts meet, each once: (K, 2)."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    skin, cut = (np.unique(edges[side].reshape(-1, 2), axis=0) for side in (~is_cut, is_cut))
    both, count = np.unique(np.concatenate([skin, cut]), axis=0, return_counts=True)
    return np.asarray(both[count == 2])


def normals(vertices_m: NDArray[Any], triangles: NDArray[np.int64]) -> NDArray[Any]:
    """Normals at vertices, of the triangles around them by their areas."""
    a, b, c = np.moveaxis(vertices_m.astype(float)[triangles], 1, 0)
    sums = np.zeros((len(vertices_m), 3))
    np.add.at(sums, triangles.reshape(-1), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 0.0, sums / np.where(length > 0.0, length, 1.0), [0.0, 1.0, 0.0])
