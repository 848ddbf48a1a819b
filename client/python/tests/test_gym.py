import functools
import subprocess
import sys

import numpy as np
import pytest
from conftest import BLOCK, PROGRAM, down

import kerf
from kerf.gym import CuttingEnv, make_cutting_env

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
    checker.check_env(env)


def test_a_picture_is_drawn_and_shows_the_cut(client):
    env = CuttingEnv(client, render_mode="rgb_array", picture_size=(160, 120), **OPTIONS)
    env.reset(seed=1)
    whole = env.render()
    assert whole.shape == (120, 160, 3)
    assert whole.dtype == np.uint8
    red = (whole[..., 0] > 1.5 * whole[..., 1]).mean()
    assert 0.02 < red < 0.6, "tissue before an empty background"
    for _ in range(30):
        env.step(np.array([0, -1, 0, 0, 0, 0]))
    cut = env.render()
    assert (np.abs(cut.astype(int) - whole).max(axis=2) > 40).sum() > 20
    seam = [((p[..., 0] < 80) & (p[..., 0] > 2.5 * p[..., 1])).sum() for p in (whole, cut)]
    assert seam[0] == 0
    assert seam[1] > 5, "the dark line of the cut"
    env.reset(seed=1)
    np.testing.assert_array_equal(env.render(), whole)
    env.close()
    silent = CuttingEnv(client, **OPTIONS)
    silent.reset(seed=1)
    assert silent.render() is None
    silent.close()
    with pytest.raises(kerf.InvalidArgumentError, match="rgb_array"):
        CuttingEnv(client, render_mode="human", **OPTIONS)


def test_it_is_made_by_its_id_on_a_server_of_its_own(monkeypatch):
    gymnasium = pytest.importorskip("gymnasium")
    monkeypatch.setenv("KERF_SERVER_PROGRAM", str(PROGRAM))
    env = gymnasium.make("kerf/Cut-v0", render_mode="rgb_array", steps_per_action=2)
    server = type(env.unwrapped)._server
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    env.step(env.action_space.sample())
    assert env.render().ndim == 3
    env.close()
    assert not server.is_running, "its server is gone with it"


@pytest.mark.filterwarnings("ignore:.*Box observation space:UserWarning")
@pytest.mark.parametrize("kind", ["SyncVectorEnv", "AsyncVectorEnv"])
def test_vectors_of_environments_step_as_one_does(server, kind):
    """More of them than the machine has cores, with hashes in the upper half of 64 bits."""
    vector = pytest.importorskip("gymnasium.vector")
    count = 6
    make = functools.partial(make_cutting_env, server.address, **OPTIONS)
    # A process that is forked while it has a connection cannot use gRPC.
    options = {"context": "spawn"} if kind == "AsyncVectorEnv" else {}
    envs = getattr(vector, kind)([make] * count, **options)
    hashes = []
    for seed in range(3):
        observations, info = envs.reset(seed=[seed] * count)
        hashes += info["state_hash"].tolist()
        observations, rewards, *_ = envs.step(np.tile([0, -1, 0, 0, 0, 0], (count, 1)).astype(np.float32))
        np.testing.assert_array_equal(observations, np.tile(observations[0], (count, 1)))
        assert len(rewards) == count
    envs.close()
    assert max(hashes) >= 1 << 63
    single = make()
    assert int(single.reset(seed=0)[1]["state_hash"]) == hashes[0]
    single.close()


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
