"""Pictures of a session, drawn without a graphics card: triangles from the farthest to the nearest, by Pillow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kerf.body import Surface
from kerf.errors import KerfError
from kerf.model import Floats, Tool

#: Pictures are drawn this many times as large along a side, and made smaller: edges are smooth.
_FINER = 2
_FIELD_OF_VIEW_RAD = 0.5
#: From where it is looked, and where the light comes from; unit vectors follow.
_EYE, _LIGHT = np.array([0.38, 0.4, 1.0]), np.array([-0.4, 1.0, 0.6])
_BACK, _SKIN, _CUT, _SEAM, _STEEL = (28, 33, 40), (168, 72, 60), (226, 142, 128), (40, 6, 8), (170, 178, 190)
#: A tool without an edge of points is drawn as a cross of this size, in sizes of the scene.
_CROSS = 0.04


class Painter:
    """Draws a scene from one place, which suits the objects at rest."""

    def __init__(self, rest_min_m: Floats, rest_max_m: Floats, tools: Sequence[Tool], size: tuple[int, int]) -> None:
        """Looks at a box.

        Raises:
            KerfError: Pillow is not installed.
        """
        try:
            from PIL import Image, ImageDraw
        except ImportError as error:
            raise KerfError(f"pictures need what `pip install kerf[gym]` installs: {error}") from error
        self._image, self._draw_on = Image, ImageDraw.Draw
        self._tools = tools
        self._size = size
        self._scene_m = float(np.linalg.norm(rest_max_m - rest_min_m))
        forward = -_EYE / np.linalg.norm(_EYE)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(right, forward), forward])
        self._eye_m = (rest_min_m + rest_max_m) / 2.0 - 2.4 * self._scene_m * forward

    def picture(self, surfaces: Sequence[Surface], poses: Floats) -> NDArray[np.uint8]:
        """Rows of red, green and blue, from the top. Tools that are not a number are not there."""
        width, height = self._size
        image = self._image.new("RGB", (_FINER * width, _FINER * height), _BACK)
        draw = self._draw_on(image)
        corners, colors, depths_m = zip(*(self._shaded(surface) for surface in surfaces), strict=True)
        order = np.argsort(-np.concatenate(depths_m))
        flat, colors_of = np.concatenate(corners).reshape(-1, 6)[order], np.concatenate(colors)[order]
        for triangle, color in zip(flat.tolist(), colors_of.tolist(), strict=True):
            draw.polygon(triangle, fill=tuple(color))
        for surface in surfaces:
            for line in self._seam(surface).tolist():
                draw.line(line, fill=_SEAM, width=2 * _FINER)
        for tool, pose in zip(self._tools, poses, strict=True):
            if not np.isnan(pose).any():
                for line in self._outline(tool, pose).reshape(-1, 4).tolist():
                    draw.line(line, fill=_STEEL, width=2 * _FINER)
        return np.asarray(image.resize(self._size, self._image.Resampling.BOX), dtype=np.uint8)

    def _seen(self, points_m: NDArray[np.floating]) -> tuple[Floats, Floats]:
        """Places in the picture, and distances along the way that it is looked."""
        x, y, z = np.moveaxis((points_m - self._eye_m) @ self._axes.T, -1, 0)
        width, height = _FINER * self._size[0], _FINER * self._size[1]
        scale = 0.5 * min(width, height) / np.tan(_FIELD_OF_VIEW_RAD / 2.0)
        far = np.maximum(z, 1e-3 * self._scene_m)
        return np.stack([width / 2.0 + scale * x / far, height / 2.0 - scale * y / far], axis=-1), z

    def _shaded(self, surface: Surface) -> tuple[Floats, NDArray[np.uint8], Floats]:
        """The triangles that face the eye: corners, colours and distances."""
        corners_m = surface.vertices_m[surface.triangles].astype(np.float64)
        normals = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
        middles_m = corners_m.mean(axis=1)
        faces = np.einsum("tx,tx->t", normals, middles_m - self._eye_m) < 0.0
        normals = normals[faces] / np.maximum(np.linalg.norm(normals[faces], axis=1, keepdims=True), 1e-30)
        light = 0.35 + 0.65 * np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
        colors = np.where(np.repeat(surface.is_cut, 2)[faces, None], _CUT, _SKIN) * light[:, None]
        places, _ = self._seen(corners_m[faces])
        return places, colors.astype(np.uint8), self._seen(middles_m[faces])[1]

    def _seam(self, surface: Surface) -> Floats:
        """Edges that a wall of a cut shares with the outside, where the outside faces the eye."""
        corners_m = surface.vertices_m[surface.quads].astype(np.float64)
        normals = np.cross(corners_m[:, 2] - corners_m[:, 0], corners_m[:, 3] - corners_m[:, 1])
        faces = np.einsum("qx,qx->q", normals, corners_m.mean(axis=1) - self._eye_m) < 0.0
        edges = np.stack([surface.quads, np.roll(surface.quads, -1, axis=1)], axis=2)
        walls = np.sort(edges[surface.is_cut].reshape(-1, 2), axis=1)
        skins = edges[~surface.is_cut & faces].reshape(-1, 2)
        keys = [low * len(surface.vertices_m) + high for low, high in (walls.T, np.sort(skins, axis=1).T)]
        seam = skins[np.isin(keys[1], keys[0])]
        return self._seen(surface.vertices_m[seam])[0].reshape(-1, 4)

    def _outline(self, tool: Tool, pose: Floats) -> Floats:
        """Lines along a tool's edge, or a cross where it has none."""
        arm = _CROSS * self._scene_m * np.eye(3)
        edge_m = tool.edge_m
        pairs_m = np.stack([edge_m[:-1], edge_m[1:]], axis=1) if len(edge_m) > 1 else np.stack([-arm, arm], axis=1)
        return self._seen(pose[:3] + _turned(pose[3:], pairs_m))[0]


def _turned(quaternion: Floats, points: Floats) -> Floats:
    """Points of a tool's frame, turned into the scene's."""
    axis, w = quaternion[:3], quaternion[3]
    across = 2.0 * np.cross(axis, points)
    return np.asarray(points + w * across + np.cross(axis, across))
