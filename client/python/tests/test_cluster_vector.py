import numpy as np
import pytest
from conftest import BLOCK, down

import kerf
from kerf.gym import CuttingEnv

pytest.importorskip("ray", reason="Ray is missing: pip install 'kerf[ray]'")
pytest.importorskip("gymnasium", reason="Gymnasium is missing: pip install 'kerf[gym]'")
vector = pytest.importorskip("kerf.cluster_vector")

OPTIONS = {"path": BLOCK, "start_pose": down()[0], "steps_per_action": 5, "max_actions": 2, "start_spread_m": 1e-3}


def test_environments_on_two_nodes_step_as_one_does(cluster, client):
    count = 4
    envs = vector.ClusterVectorEnv(count, **OPTIONS)
    nodes = {node.node_id for node in cluster.list_all_nodes()}
    assert set(envs.nodes) == nodes
    one = CuttingEnv(client, **OPTIONS)
    action = np.array([0, -1, 0, 0, 0, 0], dtype=np.float32)
    observations, infos = envs.reset(seed=3)
    assert envs.observation_space.contains(observations)
    expected = [one.reset(seed=3 + at) for at in range(count)]
    np.testing.assert_array_equal(observations, [observation for observation, _ in expected])
    assert infos["state_hash"].tolist() == [info["state_hash"] for _, info in expected]
    seen = [envs.step(np.tile(action, (count, 1))) for _ in range(3)]
    one.reset(seed=3)
    for at, (observations, rewards, terminations, truncations, infos) in enumerate(seen[:2]):
        observation, reward, *_, info = one.step(action)
        np.testing.assert_array_equal(observations[0], observation)
        assert (rewards[0], infos["state_hash"][0]) == (reward, info["state_hash"])
        assert not terminations.any()
        assert truncations.tolist() == [at == 1] * count
    # An episode has ended, and the next one has begun.
    observations, rewards, _, truncations, infos = seen[2]
    np.testing.assert_array_equal(observations[0], one.reset()[0])
    assert not truncations.any()
    assert not rewards.any()
    assert (infos["step"] == one.reset()[1]["step"]).all()
    envs.close()
    one.close()


@pytest.mark.usefixtures("cluster")
def test_what_an_environment_refuses_is_raised_here():
    with pytest.raises(kerf.NotFoundError, match="no-scene"):
        vector.ClusterVectorEnv(1, scene="no-scene")
