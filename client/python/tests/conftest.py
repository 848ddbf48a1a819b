"""A live server for the tests: `KERF_SERVER_PROGRAM`, or the repository's own build."""

import os
from pathlib import Path

import numpy as np
import pytest

import kerf

REPOSITORY = Path(__file__).parents[3]
PROGRAM = Path(os.environ.get("KERF_SERVER_PROGRAM", REPOSITORY / "target/debug/kerf-server"))

#: Small enough to step in microseconds, and so stiff that it parts under a blade before it is pressed flat.
BLOCK = REPOSITORY / "server/session/tests/block.toml"


def station(server, *options):
    """The command of a simulated Omni that presses and cuts the liver, at a session of its own."""
    program = PROGRAM.with_name("kerf-station")
    return [program, "run", "--server", f"http://{server.address}", "--scene", "liver", *options]


def down(begin_m=0.012, end_m=-0.008, x_m=0.0):
    """Two poses of a level blade that goes down through the block, between two planes of its voxels."""
    return np.array([[x_m, begin_m, 4e-4, 0, 0, 0, 1], [x_m, end_m, 4e-4, 0, 0, 0, 1]])


@pytest.fixture(scope="session")
def server():
    with kerf.LocalServer(PROGRAM) as server:
        yield server


@pytest.fixture(scope="session")
def client(server):
    with server.client() as client:
        yield client


@pytest.fixture
def session(client):
    with client.create_session(path=BLOCK) as session:
        yield session


@pytest.fixture(scope="session")
def cluster():
    """Two nodes of Ray on this machine, of one CPU and of two; who connects to Ray is on them."""
    utils = pytest.importorskip("ray.cluster_utils", reason="Ray is missing: pip install 'kerf[ray]'")
    with pytest.MonkeyPatch.context() as patch:
        # What the nodes are to know, they know from here.
        patch.setenv("KERF_SERVER_PROGRAM", str(PROGRAM))
        # A worker that has not started within a minute, as on a busy machine, is taken for dead and begun again.
        patch.setenv("RAY_worker_register_timeout_seconds", "300")
        memory = {"object_store_memory": 80 << 20}
        try:
            cluster = utils.Cluster(
                initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False, **memory}
            )
            cluster.add_node(num_cpus=2, **memory)
        except Exception as error:
            # It waits half a minute for its own processes, of which a busy machine takes more.
            pytest.skip(f"Ray does not start here: {error}")
        patch.setenv("RAY_ADDRESS", cluster.address)
        yield cluster
        pytest.importorskip("ray").shutdown()
        cluster.shutdown()


def pytest_collection_modifyitems(items):
    """Tests that need the cluster go to one worker: it takes 3 s to start."""
    for item in items:
        if "cluster" in item.fixturenames:
            item.add_marker(pytest.mark.xdist_group("cluster"))
