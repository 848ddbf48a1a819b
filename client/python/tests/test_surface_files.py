import numpy as np
import pytest
from conftest import BLOCK

import kerf

trimesh = pytest.importorskip("trimesh")
meshio = pytest.importorskip("meshio")


@pytest.fixture(scope="module")
def halves(client):
    """A block that a wide blade has gone through."""
    held = "fixed = [{ box = { min_m = [-0.02, -0.02, -0.02], max_m = [0.02, -0.005, 0.02] } }]"
    sides = "fixed = [{ box = { min_m = [-0.02, -0.02, -0.02], max_m = [0.02, 0.02, -0.008] } }]"
    text = BLOCK.read_text()
    assert held in text
    text = text.replace(held, sides).replace("width_m = 0.02", "width_m = 0.04")
    with client.create_session(toml=text) as session:
        session.drive([0.0, 0.5], [[0, 0.012, 4e-4, 0, 0, 0, 1], [0, -0.014, 4e-4, 0, 0, 0, 1]])
        session.lift()
        (surface,) = session.surfaces()
    assert len(surface.pieces()) == 2
    return surface


@pytest.mark.parametrize("ending", ["stl", "ply", "obj"])
def test_other_programs_read_the_surface(halves, tmp_path, ending):
    path = tmp_path / f"cut.{ending}"
    halves.save(path)
    read = trimesh.load(path, process=False)
    assert len(read.faces) == len(halves.triangles)
    np.testing.assert_allclose(read.triangles, halves.vertices_m[halves.triangles], atol=1e-7)


def test_a_glb_is_a_closed_body_for_each_piece(halves, tmp_path):
    halves.save(tmp_path / "cut.glb")
    scene = trimesh.load(tmp_path / "cut.glb", merge_primitives=True)
    pieces = [piece for piece in scene.geometry.values() if isinstance(piece, trimesh.Trimesh)]
    for piece in pieces:
        piece.merge_vertices(merge_norm=True, merge_tex=True)
    assert [piece.is_watertight for piece in pieces] == [True, True]
    volumes_m3 = sorted(piece.volume for piece in pieces)
    assert sum(volumes_m3) == pytest.approx(0.02**3, rel=0.05)
    a, b, c = np.moveaxis(halves.vertices_m[halves.triangles].astype(float), 1, 0)
    each = np.einsum("tx,tx->t", a, np.cross(b, c)) / 6.0
    np.testing.assert_allclose(volumes_m3, sorted(each[piece].sum() for piece in halves.pieces()), rtol=1e-5)


def test_a_glb_has_a_material_for_the_skin_and_one_for_the_cut_and_lines_where_they_meet(halves, tmp_path):
    halves.save(tmp_path / "cut.glb")
    parts = trimesh.load(tmp_path / "cut.glb").geometry
    faces, edges = {}, []
    for part in parts.values():
        if isinstance(part, trimesh.Trimesh):
            faces[part.visual.material.name] = faces.get(part.visual.material.name, 0) + len(part.faces)
        else:
            edges.append(part.vertices.reshape(-1, 2, 3))
    cut = 2 * np.count_nonzero(halves.is_cut)
    assert faces == {"block": len(halves.triangles) - cut, "block cut": cut}
    # A line goes round the wall of each half: at every place as many edges begin as end.
    assert len(edges) == 2
    for ends in edges:
        _, counts = np.unique(ends.reshape(-1, 3), axis=0, return_counts=True)
        assert (counts % 2 == 0).all()
        assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(4 * 0.02, rel=0.25)


def test_a_vtu_says_what_is_cut_and_of_which_piece(halves, tmp_path):
    halves.save(tmp_path / "cut.vtu")
    read = meshio.read(tmp_path / "cut.vtu")
    np.testing.assert_allclose(read.points, halves.vertices_m)
    np.testing.assert_array_equal(read.cell_data["is_cut"][0], np.repeat(halves.is_cut, 2))
    assert sorted(np.unique(read.cell_data["piece"][0])) == [0, 1]


def test_another_ending_is_refused_by_name(halves, tmp_path):
    with pytest.raises(kerf.InvalidArgumentError, match=r"cut\.step.*\.stl, \.ply, \.obj, \.glb, \.vtu"):
        halves.save(tmp_path / "cut.step")
