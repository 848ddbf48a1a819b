import time

import numpy as np
import pytest
from conftest import BLOCK, PROGRAM, down

import kerf


def send_until_refused(control, pose):
    for _ in range(1000):
        control.send(pose)
        time.sleep(0.01)


@pytest.fixture
def other():
    with kerf.LocalServer(PROGRAM) as server:
        yield server


def test_a_session_and_its_view_go_on_at_the_server_that_it_has_moved_to(other, server, client):
    with client.create_session(path=BLOCK) as session, session.view() as view, other.client() as there:
        first = session.drive([0.0, 0.08], down(0.012, 0.004))
        before = view.surface(step=int(first.steps[-1]))
        assert session.move(f"http://{other.address}") == first.steps[-1]
        result = session.drive([0.0, 0.08], down(0.004, -0.008))
        assert result.steps[0] == first.steps[-1] + 1
        after = view.surface(step=int(result.steps[-1]))
        assert after.topology_version > before.topology_version
        # Whoever joins there sees the same, and whoever asks the first server is told where.
        joined = there.join_session(session.id)
        assert joined.describe().state_hash == result.state_hash
        with server.client() as here, pytest.raises(kerf.MovedError, match="has moved") as told:
            here.join_session(session.id)
        assert told.value.to == f"http://{other.address}"


def test_what_is_driven_in_real_time_ends_with_the_move_and_begins_anew(other, client):
    with client.create_session(path=BLOCK, real_time=True) as session:
        pose = np.array([0.0, 0.05, 4e-4, 0, 0, 0, 1])
        with session.control() as control:
            control.send(pose)
            control.contact()
            session.move(f"http://{other.address}")
            with pytest.raises(kerf.MovedError):
                send_until_refused(control, pose)
        with session.control() as control:
            control.send(pose)
            assert control.contact().step > 0


def test_a_session_that_is_not_taken_stays(session):
    with pytest.raises(kerf.FailedPreconditionError, match="goes on here"):
        session.move("http://127.0.0.1:9")
    with pytest.raises(kerf.InvalidArgumentError) as refused:
        session.move("127.0.0.1:9")
    assert refused.value.field == "to"
    assert len(session.step(3).steps) == 3
