import signal
import subprocess
import time

import numpy as np
import pytest
from conftest import BLOCK, station

import kerf

pytest.importorskip("mcap")


def run(server, *options, ends=signal.SIGTERM, seconds=3.0):
    """What a station said and told of that is ended from outside."""
    with subprocess.Popen(
        station(server, *options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        time.sleep(seconds)
        running.send_signal(ends)
        said, told = running.communicate(timeout=60)
    return said, told


def test_a_log_has_every_tick_of_the_servo_and_is_read_into_arrays(server, tmp_path):
    said, told = run(server, "--log", tmp_path / "run.mcap", "--report", tmp_path / "report", seconds=5.0)
    (log,) = kerf.read_log(tmp_path / "run.mcap")
    assert len(log) > 1000
    # The servo's own clock: no tick is missing.
    np.testing.assert_allclose(np.diff(log.time_s), log.dt_s[1:], atol=2e-9)
    rate_hz = len(log) / log.time_s[-1]
    assert 500 < rate_hz < 1100, "a thousand a second, less what a busy machine costs"
    assert set(np.unique(log.state)) <= {"stale", "held", "tripped", "ramping", "rendering"}
    assert log.poses.shape == (len(log), 7)
    np.testing.assert_allclose(np.linalg.norm(log.poses[~np.isnan(log.poses[:, 0]), 3:], axis=1), 1.0, rtol=1e-6)
    assert np.nanmax(log.motion_age_s) > 0
    assert log.contacts[-1] > 10
    touching = ~np.isnan(log.stiffness_n_per_m[:, 0, 0])
    symmetric = log.stiffness_n_per_m[touching]
    np.testing.assert_allclose(symmetric, symmetric.transpose(0, 2, 1), rtol=1e-4, atol=1e-3)
    assert repr(log).startswith("StationLog('")
    page = (tmp_path / "report/report.md").read_text()
    assert "greatest force" in page
    for plot in ("force-0.svg", "latency-0.svg"):
        assert plot in page
        assert (tmp_path / "report" / plot).stat().st_size > 1000
    # The line has where the tool is, and where the session is to be seen.
    assert " mm, force " in said
    assert f"http://{server.address}/?session=session-" in said
    assert "to be seen at" in told


@pytest.mark.parametrize("ends", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_session_that_a_station_made_ends_with_it(server, client, ends):
    before = set(client.sessions())
    run(server, ends=ends, seconds=2.0)
    assert set(client.sessions()) <= before


def test_what_is_no_log_is_refused_in_words(tmp_path):
    other = tmp_path / "block.mcap"
    other.write_bytes(BLOCK.read_bytes())
    with pytest.raises(kerf.KerfError, match="not a station's log"):
        kerf.read_log(other)
