import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from conftest import BLOCK

import kerf

trimesh = pytest.importorskip("trimesh")
meshio = pytest.importorskip("meshio")


def severed(client, held, rest_steps):
    """A block that a wide blade has gone through, and that is left alone for so long."""
    text = BLOCK.read_text()
    before = "fixed = [{ box = { min_m = [-0.02, -0.02, -0.02], max_m = [0.02, -0.005, 0.02] } }]"
    assert before in text
    text = text.replace(before, f"fixed = [{{ box = {held} }}]").replace("width_m = 0.02", "width_m = 0.04")
    with client.create_session(toml=text) as session:
        session.drive([0.0, 0.5], [[0, 0.012, 4e-4, 0, 0, 0, 1], [0, -0.014, 4e-4, 0, 0, 0, 1]])
        session.lift()
        if rest_steps:
            session.step(rest_steps)
        (surface,) = session.surfaces()
    assert len(surface.pieces()) == 2
    return surface


@pytest.fixture(scope="module")
def halves(client):
    """One of them hangs away from the other."""
    return severed(client, "{ min_m = [-0.02, -0.02, -0.02], max_m = [0.02, 0.02, -0.008] }", 0)


@pytest.fixture(scope="module")
def shut(client):
    """Both stand beside each other, with vertices of either at the same places."""
    surface = severed(client, "{ min_m = [-0.02, -0.02, -0.02], max_m = [0.02, -0.005, 0.02] }", 1000)
    assert len(np.unique(np.round(1e8 * surface.vertices_m), axis=0)) < len(surface.vertices_m)
    return surface


@pytest.fixture(params=["halves", "shut"])
def pair(request):
    return request.getfixturevalue(request.param)


def volumes_m3(surface):
    """Of each piece, the largest first."""
    a, b, c = np.moveaxis(surface.vertices_m[surface.triangles].astype(float), 1, 0)
    each = np.einsum("tx,tx->t", a, np.cross(b, c)) / 6.0
    volumes = [each[piece].sum() for piece in surface.pieces()]
    assert sum(volumes) == pytest.approx(0.02**3, rel=0.05)
    return volumes


def bodies(mesh):
    """What hangs together by edges, the most faces first; `split` does the same, and wants another package for it."""
    lowest = np.arange(len(mesh.faces))
    one, other = mesh.face_adjacency.T
    before = None
    while before is None or (lowest != before).any():
        before = lowest.copy()
        np.minimum.at(lowest, one, lowest[other])
        np.minimum.at(lowest, other, lowest[one])
    parts = sorted((np.flatnonzero(lowest == first) for first in np.unique(lowest)), key=len, reverse=True)
    return [mesh.submesh([part], append=True, repair=False) for part in parts]


def is_mesh(geometry):
    return isinstance(geometry, trimesh.Trimesh)


@pytest.mark.parametrize("ending", ["stl", "ply", "obj"])
def test_other_programs_read_the_surface(halves, tmp_path, ending):
    path = tmp_path / f"cut.{ending}"
    assert halves.save(path) == [path]
    read = trimesh.load(path, process=False)
    assert len(read.faces) == len(halves.triangles)
    np.testing.assert_allclose(read.triangles, halves.vertices_m[halves.triangles], atol=1.1e-7)


@pytest.mark.parametrize("ending", ["stl", "ply", "obj"])
def test_a_severed_block_is_two_closed_bodies_to_who_joins_what_is_at_the_same_place(pair, tmp_path, ending):
    pair.save(tmp_path / f"cut.{ending}")
    read = bodies(trimesh.load(tmp_path / f"cut.{ending}"))
    assert [body.is_watertight for body in read] == [True, True]
    np.testing.assert_allclose([body.volume for body in read], volumes_m3(pair), rtol=1e-4)


@pytest.mark.parametrize("ending", ["stl", "ply", "obj", "glb"])
def test_each_piece_can_be_a_closed_file_the_largest_first(pair, tmp_path, ending):
    paths = pair.save(tmp_path / f"cut.{ending}", pieces=True)
    assert paths == [tmp_path / f"cut-{number}.{ending}" for number in (1, 2)] == sorted(tmp_path.iterdir())
    read = [trimesh.load_mesh(path) for path in paths]
    assert [body.is_watertight for body in read] == [True, True]
    np.testing.assert_allclose([body.volume for body in read], volumes_m3(pair), rtol=1e-4)


@pytest.mark.parametrize("load", [trimesh.load, trimesh.load_scene])
def test_a_glb_has_a_closed_body_for_each_piece(pair, tmp_path, load):
    pair.save(tmp_path / "cut.glb")
    scene = load(tmp_path / "cut.glb")
    named = {node: scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry}
    pieces = {node: body for node, body in named.items() if is_mesh(body)}
    assert sorted(pieces) == ["block 1", "block 2"]
    assert all(body.is_watertight for body in pieces.values())
    volumes = [pieces[node].volume for node in sorted(pieces)]
    np.testing.assert_allclose(volumes, volumes_m3(pair), rtol=1e-5)
    assert scene.volume == pytest.approx(sum(volumes))


def test_a_glb_tells_skin_from_cuts_by_the_colours_of_vertices_and_has_lines_where_they_meet(halves, tmp_path):
    halves.save(tmp_path / "cut.glb")
    parts = trimesh.load(tmp_path / "cut.glb").geometry.values()
    on_skin, on_cut = (
        np.isin(np.arange(len(halves.vertices_m)), halves.quads[side]) for side in (~halves.is_cut, halves.is_cut)
    )
    shown = {}
    for part in filter(is_mesh, parts):
        material = part.visual.material
        assert material.name == "block"
        np.testing.assert_array_equal(material.baseColorFactor, [178, 116, 111, 255])
        for place, color in zip(part.vertices, part.visual.vertex_attributes["color"], strict=True):
            shown[tuple(place.astype(np.float32))] = color / 65535.0
    shares = np.array([shown[tuple(place)] for place in halves.vertices_m])
    np.testing.assert_array_equal(shares[on_cut & ~on_skin], 1.0)
    for which, share in [
        (on_skin & ~on_cut, [0.5 / 0.7, 0.09 / 0.454, 0.06 / 0.436, 1]),
        (on_skin & on_cut, [0.02] * 3 + [1]),
    ]:
        assert np.count_nonzero(which) > 10
        np.testing.assert_allclose(shares[which], np.tile(share, (np.count_nonzero(which), 1)), atol=1e-5)
    # A line goes round the wall of each half: at every place as many edges begin as end.
    edges = [part.vertices.reshape(-1, 2, 3) for part in parts if not is_mesh(part)]
    assert len(edges) == 2
    for ends in edges:
        _, counts = np.unique(ends.reshape(-1, 3), axis=0, return_counts=True)
        assert (counts % 2 == 0).all()
        assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(4 * 0.02, rel=0.25)


def test_a_glb_has_a_material_for_each_region_whose_skin_has_the_stated_colour(halves, tmp_path):
    materials = (halves.vertices_m[:, 1] > 0.0).astype(np.uint8)
    colors, names = ("#000000", "#ff0080"), ("block", "tumour")
    surface = replace(halves, materials=materials, material_names=names, material_colors=colors)
    surface.save(tmp_path / "cut.glb")
    data = (tmp_path / "cut.glb").read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    for mesh in (mesh for mesh in document["meshes"] if "seam" not in mesh["name"]):
        parts = mesh["primitives"]
        assert [document["materials"][part["material"]]["name"] for part in parts] == ["block", "tumour"]
        assert len({part["attributes"]["POSITION"] for part in parts}) == 1
        for part, stated in zip(parts, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.21586)], strict=True):
            accessor = document["accessors"][part["attributes"]["COLOR_0"]]
            assert (accessor["componentType"], accessor["normalized"], accessor["type"]) == (5123, True, "VEC4")
            begin = 28 + length + document["bufferViews"][accessor["bufferView"]]["byteOffset"]
            shares = np.frombuffer(data, "<u2", 4 * accessor["count"], begin).reshape(-1, 4) / 65535.0
            base = document["materials"][part["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
            seen = np.unique((shares * base)[:, :3].round(4), axis=0)
            assert len(seen) == 3, "skin, cut, and where they meet"
            assert np.isclose(seen, stated, atol=1e-4).all(axis=1).any()


def test_a_vtu_says_what_is_cut_and_of_which_piece(halves, tmp_path):
    halves.save(tmp_path / "cut.vtu")
    read = meshio.read(tmp_path / "cut.vtu")
    np.testing.assert_allclose(read.points, halves.vertices_m)
    np.testing.assert_array_equal(read.cell_data["is_cut"][0], np.repeat(halves.is_cut, 2))
    assert sorted(np.unique(read.cell_data["piece"][0])) == [0, 1]


def test_another_ending_is_refused_by_name(halves, tmp_path):
    with pytest.raises(kerf.InvalidArgumentError, match=r"cut\.step.*\.stl, \.ply, \.obj, \.glb, \.vtu"):
        halves.save(tmp_path / "cut.step")
