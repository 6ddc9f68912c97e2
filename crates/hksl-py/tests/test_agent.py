"""Agents for training loops of one's own."""

import threading

import gymnasium
import hksl
import numpy as np
import pytest

SHAPE = (3, 43, 23)


def agent(method="hksl", seed=1, **arguments):
    arguments = {"preset": "debug", "observation_shape": SHAPE, "action_dims": 1, **arguments}
    return hksl.Agent(method, seed=seed, **arguments)


def environment():
    return gymnasium.make(
        "hksl/falling-pixels-v0", frame_stack=3, channels_last=False, config={"environment.episode_steps": 40}
    )


def play(learner, steps, seed=1):
    """Trains; returns the losses of all learning steps."""
    env, losses = environment(), []
    observation, _ = env.reset(seed=seed)
    learner.begin(observation)
    for _ in range(steps):
        action = learner.act(observation)
        losses.append(learner.update())
        observation, reward, terminated, truncated, _ = env.step(action)
        learner.observe(action, reward, observation, terminated, truncated)
        if terminated or truncated:
            observation, _ = env.reset()
            learner.begin(observation)
    return [of for of in losses if of is not None]


def test_a_loop_of_ones_own_learns_and_repeats():
    first, second = agent(), agent()
    losses = play(first, 100)
    assert len(losses) == first.updates == 60 and first.agent_step == 100
    assert {"critic_loss_1", "actor_loss"} & set(losses[0]) and all(np.isfinite(list(of.values())).all() for of in losses)
    assert play(second, 100) == losses
    assert play(agent(seed=2), 100) != losses


@pytest.mark.parametrize("method", ["pi-sac", "dreamer-v2"])
def test_pretraining_comes_before_the_first_step(method):
    learner = agent(method)
    losses = play(learner, 90)
    assert losses and learner.updates == len(losses)


def test_what_is_saved_comes_back(tmp_path):
    learner = agent()
    play(learner, 100)
    learner.save(tmp_path / "agent")
    observation, _ = environment().reset(seed=9)
    other = agent()
    other.load(tmp_path / "agent")
    assert (other.agent_step, other.updates) == (100, 60)
    greedy = [of.act(observation, explore=False) for of in (learner, other)]
    assert np.array_equal(*greedy)
    assert np.array_equal(hksl.load(tmp_path / "agent").act(observation), greedy[0])
    learner.save(tmp_path / "agent")
    # Both continue alike; the interrupted episode has ended in both.
    learner.load(tmp_path / "agent")
    assert play(learner, 50, seed=7) == play(other, 50, seed=7)
    with pytest.raises(hksl.ConfigError, match="seed is 1 in that run, not 2"):
        agent(seed=2).load(tmp_path / "agent")
    with pytest.raises(hksl.RunError):
        agent().load(tmp_path / "nothing")


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"observation_shape": (4, 43, 23)}, "multiple of environment.frame_stack"),
        ({"observation_shape": (3, 8, 8)}, "15×15"),
        ({"action_dims": 0}, "at least 1"),
        ({"method": "dqn"}, "unknown method `dqn`"),
        ({"config": {"sac.batch_size": 0}}, "sac.batch_size"),
    ],
)
def test_wrong_arguments_are_told(arguments, words):
    with pytest.raises(hksl.ConfigError) as raised:
        agent(**arguments)
    assert words in str(raised.value)


def test_wrong_calls_are_told_and_nothing_is_lost():
    learner = agent()
    frame = np.zeros(SHAPE, np.uint8)
    with pytest.raises(hksl.Error, match="begin"):
        learner.observe(np.zeros(1), 0.0, frame, False, False)
    with pytest.raises(hksl.ConfigError, match="repeat its first frame"):
        learner.begin(np.arange(3, dtype=np.uint8)[:, None, None] + frame)
    learner.begin(frame)
    for action, reward, observation, kind in [
        (np.zeros(2), 0.0, frame, hksl.ArrayError),
        (np.zeros(1), np.nan, frame, hksl.NotFiniteError),
        (np.float32([np.inf]), 0.0, frame, hksl.NotFiniteError),
        (np.zeros(1), 0.0, frame.astype(np.float32), hksl.ArrayError),
        (np.zeros(1), 0.0, np.zeros((3, 9, 9), np.uint8), hksl.ArrayError),
    ]:
        with pytest.raises(kind):
            learner.observe(action, reward, observation, False, False)
    assert learner.agent_step == 0
    learner.observe(np.zeros(1), 0.0, frame, False, True)
    assert learner.agent_step == 1 and learner.update() is None


def test_threads_that_call_one_agent_are_told_and_nothing_is_lost():
    learner = agent(config={"sac.batch_size": 64, "encoder.filters": 16})
    play(learner, 60)
    before, results = learner.updates, []

    def update():
        for _ in range(5):
            try:
                results.append(learner.update() is not None)
            except hksl.BusyError as error:
                results.append(str(error))

    threads = [threading.Thread(target=update) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    done = results.count(True)
    refused = [result for result in results if isinstance(result, str)]
    assert done + len(refused) == 15 and learner.updates == before + done
    assert refused and "another thread is using this agent" in refused[0]
    assert learner.update() is not None
