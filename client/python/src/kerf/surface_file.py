"""Surfaces as files that other programs read. All but `.glb` need `pip install kerf[mesh]`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kerf import glb_file
from kerf.errors import InvalidArgumentError, KerfError, did_you_mean

if TYPE_CHECKING:
    from kerf.body import Surface

#: Colours of the outside and of walls of cuts, sRGB and opaque.
_SKIN, _CUT = (125, 51, 42, 255), (208, 105, 90, 255)


def save(surface: Surface, path: Path) -> None:
    """Writes a surface by the ending of the path."""
    write = {".stl": _trimesh, ".ply": _trimesh, ".obj": _trimesh, ".glb": glb_file.write, ".vtu": _vtu}
    ending = path.suffix.lower()
    if ending not in write:
        limit = f"one of {', '.join(write)}"
        words = f"path: {path.name!r} ends with none of {', '.join(write)}{did_you_mean(ending, write)}"
        raise InvalidArgumentError(words, field="path", limit=limit)
    try:
        write[ending](surface, path)
    except ImportError as error:
        raise KerfError(f"files of surfaces need what `pip install kerf[mesh]` installs: {error}") from error


def _trimesh(surface: Surface, path: Path) -> None:
    import trimesh

    colors = np.where(_is_on_wall(surface)[:, None], _CUT, _SKIN).astype(np.uint8)
    # As they are: readers that join vertices by their places would join the walls of a shut cut.
    trimesh.Trimesh(surface.vertices_m, surface.triangles, vertex_colors=colors, process=False).export(path)


def _vtu(surface: Surface, path: Path) -> None:
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


def _is_on_wall(surface: Surface) -> NDArray[Any]:
    """Vertices that belong to walls of cuts alone: those of the rim keep the colour of the outside."""
    on_skin = np.zeros(len(surface.vertices_m), dtype=bool)
    on_skin[surface.quads[~surface.is_cut]] = True
    return ~on_skin
