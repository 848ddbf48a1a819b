"""Surfaces as files that other programs read. All but `.glb` need `pip install kerf[mesh]`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kerf import glb_file
from kerf.errors import InvalidArgumentError, KerfError, did_you_mean
from kerf.surface_mesh import SurfaceMesh

#: Colours of the outside and of walls of cuts, sRGB and opaque.
_SKIN, _CUT = (125, 51, 42, 255), (208, 105, 90, 255)
#: How far walls of cuts are moved into their body in files of STL: readers take places 10 nm from each other for one.
_WALL_INSET_M = 1e-7


def save(surface: SurfaceMesh, path: Path, *, pieces: bool) -> list[Path]:
    """Writes a surface, or each of its pieces, by the ending of the path."""
    write = {".stl": _stl, ".ply": _trimesh, ".obj": _trimesh, ".glb": glb_file.write, ".vtu": _vtu}
    ending = path.suffix.lower()
    if ending not in write:
        limit = f"one of {', '.join(write)}"
        words = f"path: {path.name!r} ends with none of {', '.join(write)}{did_you_mean(ending, write)}"
        raise InvalidArgumentError(words, field="path", limit=limit)
    surfaces = {path: surface}
    if pieces:
        parts = enumerate(surface.pieces(), 1)
        surfaces = {path.with_stem(f"{path.stem}-{number}"): _piece(surface, faces) for number, faces in parts}
    try:
        for file, part in surfaces.items():
            write[ending](part, file)
    except ImportError as error:
        raise KerfError(f"files of surfaces need what `pip install kerf[mesh]` installs: {error}") from error
    return list(surfaces)


def _piece(surface: SurfaceMesh, faces: NDArray[np.intp]) -> SurfaceMesh:
    """A piece, given by its triangles."""
    quads = np.unique(faces // 2)
    used, local = np.unique(surface.quads[quads], return_inverse=True)
    corners = local.reshape(-1, 4)
    return replace(
        surface,
        vertices_m=surface.vertices_m[used],
        quads=corners,
        triangles=corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3),
        is_cut=surface.is_cut[quads],
        materials=surface.materials[used],
        vertex_ids=surface.vertex_ids[used],
        quad_ids=surface.quad_ids[quads],
    )


def _stl(surface: SurfaceMesh, path: Path) -> None:
    # It has no vertices of its own, and readers would join walls that are at the same place.
    walls = surface.triangles[np.repeat(surface.is_cut, 2)]
    inset_m = _WALL_INSET_M * glb_file.normals(surface.vertices_m, walls)
    inset_m[np.isin(np.arange(len(inset_m)), walls, invert=True)] = 0.0
    _trimesh(replace(surface, vertices_m=(surface.vertices_m - inset_m).astype(np.float32)), path)


def _trimesh(surface: SurfaceMesh, path: Path) -> None:
    import trimesh

    colors = np.where(_is_on_wall(surface)[:, None], _CUT, _SKIN).astype(np.uint8)
    # With normals, opposite where walls are at the same place: readers join vertices if their normals too are the same.
    normals = glb_file.normals(surface.vertices_m, surface.triangles)
    mesh = trimesh.Trimesh(
        surface.vertices_m, surface.triangles, vertex_normals=normals, vertex_colors=colors, process=False
    )
    mesh.export(path)


def _vtu(surface: SurfaceMesh, path: Path) -> None:
    import meshio

    pieces = np.zeros(len(surface.triangles), dtype=np.int32)
    for number, faces in enumerate(surface.pieces()):
        pieces[faces] = number
    meshio.Mesh(
        surface.vertices_m.astype(np.float64),
        [("triangle", surface.triangles)],
        point_data={"material": surface.materials},
        cell_data={"is_cut": [np.repeat(surface.is_cut, 2).astype(np.uint8)], "piece": [pieces]},
    ).write(path)


def _is_on_wall(surface: SurfaceMesh) -> NDArray[Any]:
    """Vertices that belong to walls of cuts alone: those of the rim keep the colour of the outside."""
    on_skin = np.zeros(len(surface.vertices_m), dtype=bool)
    on_skin[surface.quads[~surface.is_cut]] = True
    return ~on_skin
