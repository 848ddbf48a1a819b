import numpy as np
import pytest
from conftest import BLOCK, PROGRAM, down

import kerf


def test_a_session_lives_from_its_creation_to_the_end_of_the_with(client):
    with client.create_session(path=BLOCK) as session:
        assert client.sessions()[session.id] is kerf.SessionState.PAUSED
        status = session.describe()
        assert (status.step, status.sim_time_s, status.energy) == (0, 0.0, kerf.EnergyLedger())
        assert client.join_session(session.id).scene.name == "block"
    assert session.id not in client.sessions()
    with pytest.raises(kerf.NotFoundError):
        session.describe()
    session.close()


def test_scenes_are_listed_and_can_be_read_changed_and_created(client):
    assert {"jelly", "tofu", "rubber"} <= {scene.name for scene in client.scenes()}
    text = client.scene_toml("jelly")
    with client.create_session(toml=text, level=3, step_rate_hz=100.0) as session:
        tissue, blade = session.scene.objects[0], session.scene.tools[0]
        assert (session.scene.dt_s, session.tool_index("blade")) == (0.01, 0)
        assert tissue.fracture_energy_j_per_m2 == 5000.0
        assert np.ptp(blade.edge_m[:, 0]) == pytest.approx(0.06)
        assert session.scene.tracked_point_names == ("top", "side")


def test_files_that_a_scene_names_are_sent_with_it(client, tmp_path):
    (tmp_path / "edge.csv").write_text("-10,0,0\n0,2,0\n10,0,0\n")
    edge = "edge = { file = { file = 'edge.csv', scale_m_per_unit = 0.001 } }"
    bent = f"[[tools]]\nname = 'bent'\nshape = {{ blade = {{ width_m = 0.02, height_m = 0.01, {edge} }} }}\n"
    (tmp_path / "block.toml").write_text(f"{BLOCK.read_text()}\n{bent}")
    with client.create_session(path=tmp_path / "block.toml") as session:
        assert list(session.files) == ["edge.csv"]
        assert session.scene.tools[2].edge_m[:, 1].max() == pytest.approx(0.002)


def read_until_it_ends(control):
    while True:
        control.contact(timeout_s=5.0)


def test_a_session_in_real_time_is_paused_stepped_resumed_and_driven(client):
    with client.create_session(path=BLOCK, real_time=True) as session:
        with session.control("left", contact_rate_hz=100.0) as control:
            contacts = control.play([0.0, 0.3], down())
            assert max(contact.force_n[1] for contact in contacts) > 0.05
            # Only contacts without models say where the tool is.
            poses = np.array([contact.pose for contact in contacts if not contact.flags & kerf.ContactFlags.LIFTED])
            heights_m = poses[:, 1]
            assert len(poses) > 10
            assert (np.diff(heights_m) <= 0.0).all()
            assert np.ptp(heights_m) > 0.01
            assert poses[-1, [0, 2, 6]] == pytest.approx([0.0, 4e-4, 1.0])
            assert session.describe().driven_tools == (0,)
            with pytest.raises(kerf.FailedPreconditionError):
                session.control("left")
            control.send([9.0, 0, 0, 0, 0, 0, 1])
            with pytest.raises(kerf.PoseRejectedError) as rejected:
                read_until_it_ends(control)
            assert rejected.value.field == "pose.position_m"
        stood = session.pause()
        assert session.step(3).steps.tolist() == [stood + 1, stood + 2, stood + 3]
        assert session.resume() == stood + 3
        assert session.describe().state is kerf.SessionState.RUNNING


def test_checkpoints_are_gone_back_to(session):
    session.drive([0.0, 0.1], down())
    session.save_checkpoint("half way")
    saved = session.describe()
    session.drive([0.0, 0.1], down()[::-1])
    assert session.restore_checkpoint("half way") == saved.step
    assert session.describe().state_hash == saved.state_hash
    assert [(kept.name, kept.step) for kept in session.checkpoints()] == [("half way", saved.step)]
    with pytest.raises(
        kerf.NotFoundError, match=r'checkpoint "halfway" among half way; did you mean .half way.\?'
    ) as error:
        session.restore_checkpoint("halfway")
    assert (error.value.field, error.value.limit) == ("name", "one of half way")
    session.delete_checkpoint("half way")
    with pytest.raises(kerf.NotFoundError, match=r'no checkpoint "half way"$'):
        session.restore_checkpoint("half way")


def test_a_state_goes_on_in_another_server_from_a_file(client, session, tmp_path):
    session.drive([0.0, 0.1], down())
    session.save(tmp_path / "half way.kerf")
    saved = session.describe()
    up = [{"left": [0, height_m, 4e-4, 0, 0, 0, 1]} for height_m in np.linspace(-0.008, 0.012, 100)]
    there = session.step(100, up)
    with kerf.LocalServer(PROGRAM) as other, other.client() as fresh, fresh.create_session(path=BLOCK) as elsewhere:
        assert elsewhere.load(tmp_path / "half way.kerf") == saved.step
        assert [(kept.name, kept.step) for kept in elsewhere.checkpoints()] == [("half way", saved.step)]
        assert elsewhere.describe().energy == saved.energy
        here = elsewhere.step(100, up)
        assert here.state_hash == there.state_hash
        np.testing.assert_array_equal(here.force_n, there.force_n)
        elsewhere.save(tmp_path / "again.kerf", "half way")
        assert (tmp_path / "again.kerf").read_bytes() == (tmp_path / "half way.kerf").read_bytes()
    with client.create_session("jelly") as jelly:
        before = jelly.describe().state_hash
        with pytest.raises(kerf.InvalidArgumentError, match="the file is of `block`, and this is `jelly`") as refused:
            jelly.load(tmp_path / "half way.kerf")
        assert refused.value.field == "data"
        assert (jelly.checkpoints(), jelly.describe().state_hash) == ([], before)
    there_before = client.sessions()
    with pytest.raises(kerf.InvalidArgumentError, match="the file is of `block`"):
        client.load(tmp_path / "half way.kerf", "jelly")
    assert client.sessions() == there_before
    with client.load(tmp_path / "half way.kerf", path=BLOCK) as begun:
        assert begun.describe().state_hash == saved.state_hash
    (tmp_path / "half.kerf").write_bytes((tmp_path / "half way.kerf").read_bytes()[:1000])
    with pytest.raises(kerf.InvalidArgumentError, match="cut off or changed"):
        session.load(tmp_path / "half.kerf")
    told = []
    step = session.load(tmp_path / "half way.kerf", "kept", restore=False, progress=lambda *so_far: told.append(so_far))
    size = (tmp_path / "half way.kerf").stat().st_size
    assert step == saved.step
    assert told[-1] == (size, size)
    assert session.describe().step == there.steps[-1]


BOX = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\n"""


def scene_of_a_mesh():
    """The block, whose shape is a mesh in a file."""
    mesh = 'shape = { mesh = { file = "box.obj", scale_m_per_unit = 0.01 } }'
    lines = BLOCK.read_text().splitlines()
    return "\n".join(mesh if line.startswith("shape = { box") else line for line in lines)


def test_files_of_a_scene_are_sent_in_parts_and_tell_how_far_they_are(client):
    # More than a single message may hold, 8 MiB.
    large = (BOX + "# a remark of some length\n" * 400_000).encode()
    toml = scene_of_a_mesh()
    told = []
    files = {"box.obj": large}
    with client.create_session(toml=toml, files=files, progress=lambda *so_far: told.append(so_far)) as session:
        assert session.scene.objects[0].voxels == 6 * 6 * 6
    sent, total = zip(*told, strict=True)
    assert set(total) == {len(large)}
    assert list(sent) == sorted(sent)
    assert (len(sent), sent[-1]) == (-(-len(large) // (256 << 10)), len(large))
    settings = {"transport.max_upload_bytes": 1 << 20}
    with kerf.LocalServer(PROGRAM, settings=settings) as narrow, narrow.client() as other:
        with pytest.raises(kerf.ResourceExhaustedError, match="more than 1048576 bytes") as refused:
            other.create_session(toml=toml, files=files)
        assert refused.value.limit == "max_upload_bytes"
        assert other.sessions() == {}


def test_a_scene_with_a_file_tells_how_far_it_is_while_it_is_made(client):
    told = []
    toml, files = scene_of_a_mesh(), {"box.obj": BOX.encode()}
    with client.create_session(toml=toml, files=files, making=told.append) as session:
        assert session.scene.objects[0].voxels == 6 * 6 * 6
    assert told[0].stage == "reading"
    assert [made.share for made in told] == sorted(made.share for made in told)
    with pytest.raises(kerf.InvalidArgumentError, match="poisson_ratio"):
        client.create_session(toml=toml.replace("ratio = 0.4", "ratio = 0.6"), files=files, making=told.append)


def test_what_is_refused_carries_its_field_and_limit(client, session):
    with pytest.raises(kerf.InvalidArgumentError, match="steps = 0") as refused:
        session.step(0)
    assert (refused.value.field, refused.value.limit) == ("steps", "must be 1 to 1000")
    with pytest.raises(kerf.InvalidArgumentError) as refused:
        session.step(2, [{0: down()[0]}, {0: down()[1]}])
    assert refused.value.field == "inputs[1].motions[0].pose.pose.position_m"
    # What was asked for, what is the limit, and what that is in a step.
    words = "too fast: 10.000 m/s, limit 3.000 m/s: at most 0.0060 m from the last accepted pose, not 0.0200 m"
    assert refused.value.limit == words
    with pytest.raises(kerf.NotFoundError, match="did you mean `liver`"):
        client.create_session("livre")
    with pytest.raises(kerf.NotFoundError, match="did you mean 'left'"):
        session.tool_index("lefft")
    assert session.describe().step == 0, "no step is taken"
    with pytest.raises(kerf.NotFoundError, match="no scene"):
        client.create_session("no such scene")
    with pytest.raises(kerf.InvalidArgumentError, match="young_modulus_pa"):
        client.create_session(toml=BLOCK.read_text().replace("3.0e4", "3"))
    with pytest.raises(kerf.InvalidArgumentError) as refused:
        session.drive([0.0], [[1.0, 2.0]])
    assert (refused.value.field, refused.value.limit) == ("poses", "shape (N, 7)")


def test_a_full_server_names_its_limit():
    with kerf.LocalServer(PROGRAM, settings={"session.max_sessions": 1}) as server, server.client() as client:
        client.create_session(path=BLOCK)
        with pytest.raises(kerf.ResourceExhaustedError) as refused:
            client.create_session(path=BLOCK)
        assert refused.value.limit == "max_sessions"


def test_a_server_that_is_not_there_is_said():
    with kerf.Client("127.0.0.1:9", timeout_s=2.0) as client, pytest.raises(kerf.UnavailableError):
        client.scenes()
    with pytest.raises(kerf.UnavailableError, match="max_sesions"):
        kerf.LocalServer(PROGRAM, settings={"session.max_sesions": 1})


def test_settings_of_a_local_server_are_as_python_has_them(tmp_path):
    settings = {"record_dir": str(tmp_path), "record_surface": True, "session.max_sessions": 2}
    with kerf.LocalServer(PROGRAM, settings=settings) as server, server.client() as client:
        assert client.sessions() == {}


def test_more_sessions_than_cores_wait_for_their_steps(server):
    """They are late for nobody: memory alone admits them."""
    with server.client() as client:
        made = [client.create_session("cuboid", step_rate_hz=4000.0, level=1) for _ in range(6)]
        for session in made:
            session.step(1)
            session.close()
