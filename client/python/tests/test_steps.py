import json
import subprocess

import numpy as np
import pytest
from conftest import BLOCK, PROGRAM, down

import kerf


def simulated_hash(tmp_path, script, steps, dt_s):
    """Of the same script without a network."""
    options = ["--script", script, "--duration", str(steps * dt_s), "--out", tmp_path / "run"]
    subprocess.run([PROGRAM, "simulate", BLOCK, *options], check=True, capture_output=True)
    return json.loads((tmp_path / "run/summary.json").read_text())["state_hash"]


def test_the_same_steps_lead_to_the_same_state_however_calls_divide_them(client, session):
    whole = session.drive([0.0, 0.25], down())
    assert whole.topology_version > 0
    assert whole.cutting_length_m.max() > 0
    poses = np.linspace(*down(), len(whole))
    poses[0] = down()[0]
    session.reset()
    assert session.drive([0.0, 0.25], down()).state_hash == whole.state_hash
    with client.create_session(path=BLOCK) as other:
        begin, end = down()
        between = begin + 0.4 * (end - begin)
        parts = [other.drive([0.0, 0.1], [begin, between]), other.drive([0.0, 0.15], [between, end])]
        # The second goes on from where the tool is; its ways differ from that in one piece by rounding alone.
        parted = kerf.StepResult.concatenated(parts)
        np.testing.assert_array_equal(parted.steps, whole.steps)
        np.testing.assert_allclose(parted.force_n[:, 0], whole.force_n[:, 0], atol=1e-3 * whole.force_n.max())
    with client.create_session(path=BLOCK) as other:
        motions = [{0: kerf.Placement(pose)} for pose in poses]
        hashes = [other.step(1, [each]).state_hash for each in motions]
        other.reset()
        assert other.step(len(motions), motions).state_hash == hashes[-1]


def test_a_script_of_the_drive_gives_the_same_state_without_a_network(session, tmp_path):
    with session.record() as recorder:
        session.drive([0.0, 0.25], down())
        session.lift()
        session.step(20)
    recorder.recording.save_script(tmp_path / "drive.csv")
    status = session.describe()
    simulated = simulated_hash(tmp_path, tmp_path / "drive.csv", status.step, session.scene.dt_s)
    assert int(str(simulated), 16) == status.state_hash


def test_every_joule_is_booked_and_the_steady_force_pays_for_the_cut(session):
    result = session.drive([0.0, 0.25], down())
    energy = result.energy
    spent = sum(getattr(energy, term) for term in kerf.ENERGY_TERMS) - energy.tool_work_j - energy.load_work_j
    assert spent == pytest.approx(energy.tool_work_j + energy.load_work_j, rel=1e-9)
    # Griffith: Gc times the area that parted, 20 mm wide, to the depth that the edge has reached.
    assert energy.fracture_j == pytest.approx(5.0 * 0.02 * 0.018, rel=0.15)
    # Work of the force along the way is what the ledger has for the tool.
    moved_m = np.gradient(np.interp(result.sim_time_s, [0.0, 0.25], down()[:, 1]))
    work_j = -np.sum(result.force_n[:, 0, 1] * moved_m)
    assert work_j == pytest.approx(energy.tool_work_j, rel=0.05)


def test_a_tool_that_is_lifted_feels_nothing(session):
    session.drive([0.0, 0.2], down())
    result = session.lift()
    assert kerf.ContactFlags(int(result.flags[-1, 0])) & kerf.ContactFlags.LIFTED
    assert not result.force_n[-1].any()


def test_a_recording_is_saved_loaded_and_replayed_to_the_same_hashes(client, session, tmp_path):
    with session.record() as recorder:
        session.step(5)
        session.reset()
        session.drive([0.01, 0.25], down())
        session.step(30, [{0: None, "right": kerf.Placement(down(x_m=0.002)[0])}])
    session.step()
    recording = recorder.recording
    assert len(recording.told) == len(recording.result) == 125 + 30, "what was before the reset is gone"
    recording.save(tmp_path / "drive.npz")
    loaded = kerf.Recording.load(tmp_path / "drive.npz")
    replayed = loaded.replay(client)
    assert replayed.state_hash == recording.result.state_hash
    np.testing.assert_array_equal(replayed.force_n, recording.result.force_n)
    np.testing.assert_array_equal(replayed.energies_j, recording.result.energies_j)

    changed = loaded.poses.copy()
    changed[100, 0, 1] += 1e-3
    with pytest.raises(kerf.KerfError, match="after step 125"):
        kerf.Recording(**{**vars(loaded), "poses": changed}).replay(client)


def test_a_recording_begins_at_rest(session):
    session.step()
    with pytest.raises(kerf.KerfError, match="at rest"):
        session.record()


def test_a_result_prints_six_lines_and_says_where_tools_were_and_how_deep(session):
    result = session.drive([0.0, 0.25], down())
    assert len(repr(result).splitlines()) == 6
    assert "StepResult of 125 steps" in repr(result)
    # As it was told, evenly; the other tool is not there.
    np.testing.assert_allclose(result.poses[-1, 0], down()[1])
    np.testing.assert_allclose(result.poses[0, 0], down()[0])
    assert np.isnan(result.poses[:, 1]).all()
    # From where it first felt something, 2 mm below its start, to its end.
    touched = np.flatnonzero(result.force_n[:, 0].any(axis=1))[0]
    expected_m = result.poses[touched, 0, 1] - result.poses[:, 0, 1]
    np.testing.assert_allclose(result.depth_m[touched:, 0], expected_m[touched:], atol=1e-12)
    assert (result.depth_m[:touched] == 0).all()
    assert 0.017 < result.depth_m[-1, 0] < 0.019
    out = session.drive([0.0, 0.1], down(-0.008, 0.02))
    assert out.depth_m[-1, 0] == 0
    assert np.isnan(session.lift().poses[-1]).all()
    session.reset()
    assert session.drive([0.0, 0.25], down()).depth_m[-1, 0] == result.depth_m[-1, 0]


def test_what_is_recorded_is_saved_at_once(session, tmp_path):
    with session.record() as recorder:
        result = session.drive([0.0, 0.1], down())
    recorder.save(tmp_path / "drive.npz")
    loaded = kerf.Recording.load(tmp_path / "drive.npz")
    np.testing.assert_array_equal(loaded.result.poses, result.poses)
    np.testing.assert_array_equal(loaded.result.depth_m, result.depth_m)


def test_sessions_step_together_as_each_does(client):
    track = [{0: pose} for pose in np.linspace(*down(), 100)]
    sessions = [client.create_session(path=BLOCK) for _ in range(3)]
    alone = sessions[0].step(100, track)
    moved, rested = client.step_together([kerf.Steps(sessions[1], 100, track), kerf.Steps(sessions[2], 3)])
    assert (moved.state_hash, list(rested.steps)) == (alone.state_hash, [1, 2, 3])
    np.testing.assert_array_equal(moved.poses, alone.poses)
    with pytest.raises(kerf.InvalidArgumentError) as refused:
        client.step_together([kerf.Steps(sessions[2]), kerf.Steps(sessions[1], 0)])
    assert refused.value.field == "sessions[1].steps"
    assert sessions[2].describe().step == 3
    # More steps than one call takes: in as many calls as it needs.
    results = client.step_together([kerf.Steps(sessions[2], 1000)] * 11)
    assert [int(result.steps[-1]) for result in results] == [1003 + 1000 * at for at in range(11)]
    assert client.step_together([]) == []
    for session in sessions:
        session.close()
