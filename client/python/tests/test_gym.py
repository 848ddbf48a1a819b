import subprocess
import sys

import numpy as np
import pytest
from conftest import BLOCK, down

from kerf.gym import CuttingEnv

OPTIONS = {
    "path": BLOCK,
    "start_pose": down()[0],
    "steps_per_action": 5,
    "max_actions": 30,
    "max_speed_m_per_s": 0.1,
    "start_spread_m": 1e-3,
}


@pytest.fixture
def env(client):
    env = CuttingEnv(client, **OPTIONS)
    yield env
    env.close()


def episode(env, seed):
    observation, info = env.reset(seed=seed)
    seen, rewards, hashes = [observation], [], [info["state_hash"]]
    truncated = False
    while not truncated:
        action = np.array([0.2 * env.np_random.uniform(-1, 1), -1, 0, 0, 0.1, 0])
        observation, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.shape == observation.shape
        assert not terminated
        seen.append(observation)
        rewards.append(reward)
        hashes.append(info["state_hash"])
    return np.array(seen), np.array(rewards), hashes


def test_an_episode_is_repeated_by_its_seed(env):
    first, second, other = episode(env, 1), episode(env, 1), episode(env, 2)
    np.testing.assert_array_equal(first[0], second[0])
    assert first[2] == second[2] != other[2]
    assert len(first[1]) == 30
    assert first[1].sum() > 0, "it cuts"
    np.testing.assert_allclose(np.linalg.norm(first[0][:, 3:7], axis=1), 1.0, rtol=1e-6)


def test_the_reward_and_the_end_are_hooks(client):
    options = {**OPTIONS, "reward": lambda moment: -moment.result.force_n[-1, 0, 1]}
    env = CuttingEnv(client, is_done=lambda moment: moment.pose[1] < 0.009, **options)
    env.reset(seed=3)
    done, rewards = False, []
    while not done:
        _, reward, done, truncated, _ = env.step(np.array([0, -1, 0, 0, 0, 0]))
        assert not truncated
        rewards.append(reward)
    assert min(rewards) < 0
    env.close()


# Forces have no bounds.
@pytest.mark.filterwarnings("ignore:.*Box observation space:UserWarning")
def test_it_is_an_environment_of_gymnasium(env):
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    checker.check_env(env, skip_render_check=True)


def test_without_gymnasium_it_is_the_same(server, env):
    program = f"""
import sys
sys.modules["gymnasium"] = None
import numpy as np, kerf
from kerf.gym import CuttingEnv
with kerf.Client({server.address!r}) as client:
    env = CuttingEnv(client, path={str(BLOCK)!r}, start_pose={down()[0].tolist()}, start_spread_m=1e-3)
    assert env.action_space.sample().shape == (6,)
    print(env.reset(seed=5)[1]["state_hash"])
    env.step(np.zeros(6))
    env.close()
"""
    said = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert int(said) == env.reset(seed=5)[1]["state_hash"]
