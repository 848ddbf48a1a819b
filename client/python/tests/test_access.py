"""A server with TLS that asks for tokens."""

import subprocess

import pytest
from conftest import BLOCK, PROGRAM

import kerf


@pytest.fixture(scope="module")
def secured(tmp_path_factory):
    """A server that is, its folder, and a driver's token."""
    folder = tmp_path_factory.mktemp("security")
    token = subprocess.check_output(
        [PROGRAM, "token", "new", "--name", "anna", "--role", "driver", "--file", folder / "tokens.toml"], text=True
    ).strip()
    with kerf.LocalServer(PROGRAM, settings={"security.dir": folder}) as server:
        yield server, folder, token


def test_a_client_with_a_token_cuts_over_tls(secured):
    server, folder, token = secured
    client = kerf.Client(f"https://{server.address}", token=token, ca_file=folder / "certificate.pem")
    with client, client.create_session(path=BLOCK, private=True) as session:
        assert session.step(2).steps.tolist() == [1, 2]
        assert session.id in client.sessions()
        with session.view() as view:
            assert view.surfaces()
        session.save(folder / "state.kerf")
        assert session.load(folder / "state.kerf")


def test_token_and_certificate_come_from_the_environment(secured, monkeypatch):
    server, folder, token = secured
    (folder / "token").write_text(f"{token}\n")
    monkeypatch.setenv("KERF_TOKEN_FILE", str(folder / "token"))
    monkeypatch.setenv("KERF_CA_FILE", str(folder / "certificate.pem"))
    with kerf.Client(server.address) as client:
        assert client.sessions() == {}


@pytest.mark.parametrize("token", [None, "wrong"])
def test_without_the_right_token_nothing_is_said(secured, token):
    server, folder, _ = secured
    client = kerf.Client(server.address, token=token, ca_file=folder / "certificate.pem")
    with client, pytest.raises(kerf.AccessDeniedError, match="token"):
        client.sessions()


def test_a_server_that_nobody_vouches_for_is_not_talked_to(secured):
    server, _, token = secured
    client = kerf.Client(f"https://{server.address}", token=token, timeout_s=2.0)
    with client, pytest.raises(kerf.UnavailableError):
        client.sessions()
