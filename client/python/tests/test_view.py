import json
import socket
import struct
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import BLOCK, PROGRAM, down

import kerf
from kerf import surface_hash
from kerf.replica import Assembler, Replica
from kerf.v1 import view_pb2 as pb


def volume_m3(surface):
    """Enclosed by the triangles (divergence theorem)."""
    a, b, c = surface.vertices_m[surface.triangles.T].astype(float)
    return np.einsum("tx,tx->", a, np.cross(b, c)) / 6.0


def test_the_surface_is_followed_through_a_cut_and_is_what_a_late_viewer_sees(session):
    with session.view() as view:
        whole = view.surface()
        assert volume_m3(whole) == pytest.approx(0.02**3, rel=0.15)
        assert not whole.is_cut.any()
        hashes, versions = [view.surface_hash()], [whole.topology_version]
        for begin_m, end_m in [(0.012, 0.004), (0.004, -0.002), (-0.002, -0.008)]:
            result = session.drive([0.0, 0.08], down(begin_m, end_m))
            followed = view.surface(step=int(result.steps[-1]))
            assert followed.topology_version == result.topology_version
            # A keyframe of its own, against patches one after the other.
            with session.view() as late:
                seen = late.surface("block")
                assert late.surface_hash() == view.surface_hash()
            np.testing.assert_array_equal(seen.vertices_m, followed.vertices_m)
            np.testing.assert_array_equal(seen.triangles, followed.triangles)
            hashes.append(view.surface_hash())
            versions.append(followed.topology_version)
        assert len(set(hashes)) == len(set(versions)) == 4, "each part of the way cuts"
        assert followed.is_cut.sum() > 20
        # Closed: every directed edge is cancelled by its opposite.
        edges = followed.quads[:, [0, 1, 1, 2, 2, 3, 3, 0]].reshape(-1, 2)
        forth, back = (sorted(map(tuple, way.tolist())) for way in (edges, edges[:, ::-1]))
        assert forth == back
        with pytest.raises(kerf.NotFoundError):
            view.surface("no such object")
        session.reset()
        again = view.surface()
        while again.topology_version:
            again = view.surface()
        assert not again.is_cut.any()


def test_one_look_shows_every_object(session):
    (surface,) = session.surfaces()
    assert surface.object_name == "block"
    assert (surface.vertices_m.dtype, surface.quads.shape[1]) == (np.float32, 4)
    assert surface.materials.shape == surface.vertex_ids.shape


def mix(x):
    mask = (1 << 64) - 1
    x = (x + 0x9E3779B97F4A7C15) & mask
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & mask
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & mask
    return x ^ (x >> 31)


def test_arrays_are_hashed_as_the_protocol_says_of_one():
    def of_words(*words):
        value = 0
        for word in words:
            value = mix(value ^ word)
        return value

    ids, elements = np.array([3, 9], dtype=np.uint32), np.array([1, 2], dtype=np.uint32)
    local = np.array([[0.25, 0.5, 1.0], [0.0, 1.0, 0.125]], dtype=np.float32)
    bits = local.view(np.uint32).astype(object)
    materials = np.array([0, 4], dtype=np.uint32)
    of_each = zip([3, 9], [1, 2], [0, 4], bits, strict=True)
    words = [(i << 32 | e, u << 32 | v, m << 32 | w) for i, e, m, (u, v, w) in of_each]
    vertices = surface_hash.sum_of_vertices(ids, elements, local, materials)
    assert vertices == sum(of_words(*each) for each in words) % 2**64
    quads = surface_hash.sum_of_quads(ids[:1], np.array([[4, 5, 6, 7]], dtype=np.uint32))
    assert quads == of_words(3 << 32 | 4, 5 << 32 | 6, 1 << 48 | 7)
    weights = np.array([[0.0, 0.125, 0.25, 0.5, 0.0, 0.0, 0.0625, 0.75]], dtype=np.float32)
    a, b, c, d, e, f, g, h = weights.view(np.uint32)[0].tolist()
    held = surface_hash.sum_of_held(ids[1:], weights)
    assert held == of_words(9 << 32 | a, b << 32 | c, d << 32 | e, f << 32 | g, 1 << 49 | h)
    assert surface_hash.of_surface([vertices, quads]) == of_words(vertices, quads)


def cube():
    """A unit cube, one element, with a vertex at each of four corners and a quad between them."""
    corners = [[c & 1, c >> 1 & 1, c >> 2] for c in range(8)]
    local = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    return {
        "node_count": 8,
        "node_ids": range(8),
        "node_rest_m": np.ravel(corners),
        "element_ids": [5],
        "element_nodes": range(8),
        "vertex_ids": [10, 11, 12, 13],
        "vertex_elements": [5] * 4,
        "vertex_local": np.ravel(local),
        "quad_ids": [0],
        "quad_vertices": [10, 11, 12, 13],
    }


def hash_of(body):
    ids, local = np.array(body.vertex_ids, dtype=np.uint32), np.reshape(body.vertex_local, (-1, 3)).astype(np.float32)
    materials = np.array(body.vertex_materials or [0] * len(ids), dtype=np.uint32)
    elements, weights = np.array(body.vertex_elements), np.reshape(body.held_vertex_weights, (-1, 8))
    items = [
        surface_hash.sum_of_vertices(ids, elements, local, materials),
        surface_hash.sum_of_held(np.array(body.held_vertex_ids, dtype=np.uint32), weights.astype(np.float32)),
        surface_hash.sum_of_quads(np.array(body.quad_ids), np.reshape(body.quad_vertices, (-1, 4))),
    ]
    return surface_hash.of_surface([sum(items) % 2**64])


def keyframe(body, version=3, expected=None):
    bodies = [pb.BodyStructure(quantum_m=QUANTUM_M, **body)]
    expected = expected or hash_of(bodies[0])
    return pb.ViewResponse(keyframe=pb.Keyframe(topology_version=version, bodies=bodies, surface_hash=expected))


#: A quarter of a metre, so that the tests' numbers are whole.
QUANTUM_M = 0.25


def packed(values):
    """Small integers as the wire has them, each zero on its own."""
    return b"".join(b"\0\0" if value == 0 else bytes([2 * value if value > 0 else -2 * value - 1]) for value in values)


def state(moved_m, version=3, reference=None, **adapted):
    quanta = (np.ravel(moved_m) / QUANTUM_M).astype(int)
    body = pb.BodyState(displacements=packed(quanta), reference=reference or b"", **adapted)
    has_reference = reference is not None
    return pb.ViewResponse(state=pb.State(topology_version=version, step=7, bodies=[body], has_reference=has_reference))


def test_vertices_move_with_their_element_and_by_their_adapted_offset():
    replica = Replica(["cube"])
    replica.apply(keyframe(cube()))
    with pytest.raises(kerf.ReplicaError, match="no state yet"):
        replica.surfaces()
    replica.apply(state([[0.5, 0.0, 0.0]] * 8, adapted_ids=packed([11]), adapted_offsets=packed([0, 1, 0])))
    (surface,) = replica.surfaces()
    assert surface.vertices_m.tolist() == [[0.5, 0, 0], [1.5, 0.25, 0], [1.5, 1, 0], [0.5, 1, 0]]
    # Along the diagonal from the first vertex.
    assert surface.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    # Half a metre in the reference, a quarter beyond it: in that state and in those after it.
    half = packed([2, 0, 0] * 8)
    for reference in (half, None):
        replica.apply(state([[0.25, 0.0, 0.0]] * 8, reference=reference))
        assert replica.surfaces()[0].vertices_m[0, 0] == 0.75
    replica.apply(state([[0.0, 0.0, 0.0]] * 8))
    assert replica.surfaces()[0].vertices_m[0, 0] == 0.5
    replica.apply(state([[9.0, 0.0, 0.0]] * 8, version=2))
    assert replica.surfaces()[0].vertices_m[0, 0] == 0.5, "a state of another version is dropped"


def test_what_does_not_fit_is_refused_with_its_field():
    def refused(**changes):
        with pytest.raises(kerf.ReplicaError) as error:
            Replica(["cube"]).apply(keyframe({**cube(), **changes}))
        return error.value.field

    assert refused(vertex_elements=[5, 5, 6, 5]) == "keyframe.bodies[0].vertex_elements"
    assert refused(quad_vertices=[10, 11, 12, 14]) == "keyframe.bodies[0].quad_vertices"
    assert refused(element_nodes=[0, 1, 2, 3, 4, 5, 6, 8]) == "keyframe.bodies[0].element_nodes"
    assert refused(node_ids=[0, 1, 2, 3, 4, 5, 7, 6]) == "keyframe.bodies[0].node_ids"
    assert refused(node_count=4) == "keyframe.bodies[0].node_ids"
    with pytest.raises(kerf.ReplicaError, match="surface hash"):
        Replica(["cube"]).apply(keyframe(cube(), expected=1))
    replica = Replica(["cube"])
    replica.apply(keyframe(cube()))
    with pytest.raises(kerf.ReplicaError, match="displacements: 21 integers, 24 expected"):
        replica.apply(state([[0.0, 0.0, 0.0]] * 7))


def test_fragments_become_the_message_that_they_were_cut_from():
    whole = keyframe(cube())
    data = whole.SerializeToString()
    assembler = Assembler()
    for size in (1, 7, 1000):
        parts = [data[at : at + size] for at in range(0, len(data), size)]
        fragments = [pb.Fragment(data=part, remaining=len(parts) - 1 - i) for i, part in enumerate(parts)]
        taken = [assembler.take(pb.ViewResponse(fragment=fragment)) for fragment in fragments]
        assert taken == [None] * (len(parts) - 1) + [whole]
    assembler.take(pb.ViewResponse(fragment=pb.Fragment(data=b"x", remaining=2)))
    with pytest.raises(kerf.ReplicaError):
        assembler.take(pb.ViewResponse(hello=pb.ViewHello()))
    assert assembler.take(whole) == whole


def test_a_vertex_beside_what_is_held_moves_by_its_own_weights_until_it_comes_anew():
    replica = Replica(["cube"])
    weights = [0, 0, 0.5, 0, 0, 0, 0, 0]
    replica.apply(keyframe({**cube(), "held_vertex_ids": [10], "held_vertex_weights": weights}))
    replica.apply(state([[0.25, 0.0, 0.0]] * 8))
    assert replica.surfaces()[0].vertices_m[:2, 0].tolist() == [0.125, 1.25]
    anew = {"node_count": 8, "vertex_ids": [10], "vertex_elements": [5], "vertex_local": [0, 0, 0]}
    bodies = [pb.BodyStructure(**anew)]
    unheld = hash_of(pb.BodyStructure(**cube()))
    assert unheld != replica.surface_hash, "the hash knows of the weights"
    patch = pb.TopologyPatch(from_version=3, to_version=4, bodies=bodies, surface_hash=unheld)
    replica.apply(pb.ViewResponse(patch=patch))
    replica.apply(state([[0.25, 0.0, 0.0]] * 8, version=4))
    assert replica.surfaces()[0].vertices_m[0, 0] == 0.25


@pytest.mark.parametrize("name", ["cut", "cut-vertices"])
def test_a_recorded_stream_is_decoded_as_it_is_written_down(name):
    vectors = Path(__file__).parents[3] / "proto" / "vectors"
    data = (vectors / f"{name}.bin").read_bytes()
    assembler, replica, at = Assembler(), None, 0
    expected = iter(json.loads((vectors / f"{name}.json").read_text()))
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        message = assembler.take(pb.ViewResponse.FromString(data[at + 4 : at + 4 + length]))
        at += 4 + length
        if message is None:
            continue
        entry = next(expected)
        assert message.WhichOneof("message") == entry["message"]
        if entry["message"] == "keyframe":
            replica = Replica([f"object {i}" for i in range(len(message.keyframe.bodies))])
        if replica is None:
            continue
        replica.apply(message)
        if entry.get("surface_hash"):
            assert f"{replica.surface_hash:016x}" == entry["surface_hash"].removeprefix("0x")
        for vertex in entry.get("shown") or []:
            surface = replica.surfaces()[vertex["object"]]
            place = int(np.searchsorted(surface.vertex_ids, vertex["id"]))
            assert np.allclose(surface.vertices_m[place], vertex["position_m"], rtol=0, atol=1e-7)
    assert next(expected, None) is None


def test_a_view_goes_on_with_a_session_that_comes_back_after_a_kill(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"

    def start():
        command = [PROGRAM, "serve", "--listen", address, "--log-filter", "error", "--set", f"journal_dir={tmp_path}"]
        return subprocess.Popen(command)

    process = start()
    try:
        with kerf.Client(address) as client:
            client.wait_until_ready(30.0)
            session = client.create_session(path=BLOCK)
            with session.view() as view:
                result = session.drive([0.0, 0.08], down(0.012, 0.004))
                before = view.surface(step=int(result.steps[-1]))
                time.sleep(0.5)
                process.kill()
                process.wait()
                process = start()
                client.wait_until_ready(30.0)
                deadline = time.monotonic() + 30.0
                while True:
                    try:
                        session.step(1)
                        break
                    except kerf.UnavailableError:
                        # It is not back yet.
                        assert time.monotonic() < deadline
                        time.sleep(0.05)
                after = view.surface(step=int(result.steps[-1]) + 1, timeout_s=20.0)
                assert (after.vertex_ids == before.vertex_ids).all()
                assert (after.quads == before.quads).all()
                assert before.is_cut.any()
    finally:
        process.kill()
        process.wait()


def test_a_view_whose_connection_is_closed_ends_in_words(server):
    client = server.client()
    session = client.create_session(path=BLOCK, real_time=True)
    view = session.view()
    view.surface()
    client.close()
    with pytest.raises(kerf.UnavailableError):
        view.surface(step=10**6)
    with pytest.raises(kerf.UnavailableError, match="was closed"):
        session.describe()
