"""What a surface consists of, and its files are written from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
U32 = NDArray[np.uint32]


@dataclass(frozen=True)
class SurfaceMesh:
    """What a `Surface` consists of. N vertices, M quads."""

    #: Name of the object.
    object_name: str
    #: Where the vertices are, scene frame. (N, 3)
    vertices_m: F32
    #: Indices into the vertices, counter-clockwise seen from outside. (M, 4)
    quads: NDArray[np.int64]
    #: Two for each quad, split along the diagonal from its first vertex. (2 M, 3)
    triangles: NDArray[np.int64]
    #: Whether a blade laid the quad open; else it is the object's own surface. (M,)
    is_cut: NDArray[np.bool_]
    #: Indices into `SceneObject.material_names`. (N,)
    materials: NDArray[np.uint8]
    #: Ids, ascending; they stay as the surface changes. (N,) and (M,)
    vertex_ids: U32
    quad_ids: U32
    #: Steps taken.
    step: int
    topology_version: int
    #: Names of the materials, and their colours as `"#rrggbb"`, sRGB, empty where the scene states none.
    material_names: tuple[str, ...] = ()
    material_colors: tuple[str, ...] = ()

    def pieces(self) -> list[NDArray[np.intp]]:
        """Indices of the triangles of each closed surface that nothing joins to the others, the largest first."""
        roots = _components(self.quads, len(self.vertices_m))[self.triangles[:, 0]]
        pieces = [np.flatnonzero(roots == root) for root in np.unique(roots)]
        return sorted(pieces, key=len, reverse=True)


def _components(quads: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Of each vertex the lowest of those that quads join it to."""
    lowest = np.arange(count)
    while True:
        of_quad = lowest[quads].min(axis=1)
        lower = lowest.copy()
        np.minimum.at(lower, quads.reshape(-1), np.repeat(of_quad, 4))
        # Half the way at once: what a vertex points to points further.
        lower = lower[lower]
        if np.array_equal(lower, lowest):
            return lower
        lowest = lower
