import io
import sys

import pytest

import kerf
from kerf.making_bar import in_plain_words
from kerf.v1 import session_pb2 as pb


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Server:
    """As much of a connection as the creation of a session needs."""

    timeout_s = 1.0

    def __init__(self, *answers):
        self.answers = answers
        self.called = []

    def read(self, method, *_):
        self.called.append(method)
        for answer in self.answers:
            if isinstance(answer, Exception):
                raise answer
            yield answer

    def call(self, method, _, response):
        self.called.append(method)
        return response()

    def close(self):
        pass


def progress(share, stage=pb.MAKING_STAGE_SOLVER, **more):
    return pb.MakeSessionResponse(progress=pb.MakingProgress(share=share, stage=stage, **more))


CREATED = pb.MakeSessionResponse(created=pb.CreateSessionResponse())


def client_of(*answers):
    client = kerf.Client("127.0.0.1:9")
    client.close()
    client._transport = Server(*answers)
    return client


def terminal_of(monkeypatch, columns=100):
    """Not a fixture: before the test runs pytest puts a stream of its own there."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", str(columns))
    return terminal


def test_a_bar_tells_on_a_terminal_how_far_a_scene_is_and_is_gone_after_it(monkeypatch):
    terminal = terminal_of(monkeypatch)
    made = [progress(0.25, objects=1, voxels=30_420), progress(0.5, pb.MAKING_STAGE_READING), CREATED]
    client_of(*made).create_session("jelly")
    _, first, second, cleared, end = terminal.getvalue().split("\r")
    assert first == f"[{'#' * 6}{'-' * 18}] 25 % makes the tissue, 30420 voxels: sets up the solver"
    assert second.rstrip() == f"[{'#' * 12}{'-' * 12}] 50 % reads the scene"
    assert len(second) == len(first), "the longer line is drawn over"
    assert (cleared.strip(), end) == ("", "")
    assert len(cleared) >= len(second.rstrip())


def test_a_bar_is_gone_after_a_refusal_and_no_wider_than_the_terminal(monkeypatch):
    terminal = terminal_of(monkeypatch, columns=40)
    client = client_of(progress(1.0, objects=1), kerf.InvalidArgumentError("no"))
    with pytest.raises(kerf.InvalidArgumentError):
        client.create_session("jelly")
    _, drawn, cleared, _ = terminal.getvalue().split("\r")
    assert len(drawn) == len(cleared) == 39
    assert not cleared.strip()


def test_nothing_is_drawn_where_it_is_not_wanted_or_nobody_looks(monkeypatch):
    terminal = terminal_of(monkeypatch)
    client = client_of(progress(0.5), CREATED)
    client.create_session("jelly", making=None)
    told = []
    client.create_session("jelly", making=told.append)
    assert [made.share for made in told] == [0.5]
    monkeypatch.setattr(terminal, "isatty", lambda: False)
    client.create_session("jelly")
    monkeypatch.setattr(sys, "stderr", None)
    client.create_session("jelly")
    assert terminal.getvalue() == ""
    create, make = "SessionService/CreateSession", "SessionService/MakeSession"
    assert client._transport.called == [create, make, create, create]


def test_progress_says_which_tissue_how_large_and_what_is_done():
    def words(stage, **more):
        return in_plain_words(kerf.Making.of(pb.MakingProgress(stage=stage, **more)))

    assert words(pb.MAKING_STAGE_SOLVER, objects=2, object=1, voxels=30_420) == (
        "makes tissue 2 of 2, 30420 voxels: sets up the solver"
    )
    assert words(pb.MAKING_STAGE_VOXELS, objects=1) == "makes the tissue: fills its voxels"
    # A server that is newer may have stages of its own.
    assert words(99, objects=1) == words(pb.MAKING_STAGE_READING) == "reads the scene"
