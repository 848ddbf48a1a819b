import numpy as np
import pytest
from conftest import BLOCK, down

from kerf.gym import CuttingEnv

pytest.importorskip("gymnasium", reason="Gymnasium is missing: pip install 'kerf[gym]'")
vector = pytest.importorskip("kerf.vector")

OPTIONS = {"path": BLOCK, "start_pose": down()[0], "steps_per_action": 5, "max_actions": 2, "start_spread_m": 1e-3}


def test_environments_that_step_at_once_step_as_one_does(client):
    count = 3
    envs = vector.CuttingVectorEnv(client, count, **OPTIONS)
    one = CuttingEnv(client, **OPTIONS)
    actions = np.zeros((count, 6), dtype=np.float32)
    actions[:, 1] = [-1.0, -0.5, 0.5]
    observations, infos = envs.reset(seed=3)
    assert envs.observation_space.contains(observations)
    seen = [(observations, infos), *((stepped[0], stepped[4]) for stepped in (envs.step(actions), envs.step(actions)))]
    for at in range(count):
        expected = [one.reset(seed=3 + at)]
        for _ in range(2):
            observation, _, _, is_truncated, info = one.step(actions[at])
            expected.append((observation, info))
        assert is_truncated
        for (observations, infos), (observation, info) in zip(seen, expected, strict=True):
            np.testing.assert_array_equal(observations[at], observation)
            assert infos["state_hash"][at] == info["state_hash"]
    # All episodes have ended: the next ones begin, whatever the actions are.
    observations, rewards, _, truncations, infos = envs.step(actions)
    assert (infos["step"] == seen[0][1]["step"]).all()
    assert not truncations.any()
    assert not rewards.any()
    envs.close()
    one.close()
