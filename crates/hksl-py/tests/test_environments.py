"""hksl's tasks as Gymnasium environments."""

import threading

import gymnasium
import hksl
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

TASKS = hksl.tasks()
FALLING = "hksl/falling-pixels-v0"
QUICK = {"environment.episode_steps": 48}
# Rendering with shadows takes most of a test without a GPU.
PLAIN = {"render.shadows": False, "render.reflections": False, "render.samples": 0}


def test_every_task_is_registered():
    assert len(TASKS) == 7
    assert all(f"hksl/{task}-v0" in gymnasium.registry for task in TASKS)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("task", TASKS)
def test_gymnasiums_checker_finds_nothing(task):
    config = {} if task == "falling-pixels" else PLAIN
    env = gymnasium.make(f"hksl/{task}-v0", render_mode="rgb_array", config=config)
    check_env(env.unwrapped)
    assert env.observation_space.dtype == np.uint8
    env.close()


@pytest.mark.parametrize("task", ["falling-pixels", "cartpole-swingup"])
def test_an_episode_is_truncated_at_its_limit(task):
    repeat = {"falling-pixels": 1, "cartpole-swingup": 8}[task]
    env = gymnasium.make(f"hksl/{task}-v0", config=QUICK)
    assert env.unwrapped.steps_per_episode == 48 // repeat
    env.reset(seed=1)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(48 // repeat)]
    assert ends == [(False, False)] * (48 // repeat - 1) + [(False, True)]
    with pytest.raises(hksl.TaskError, match="reset"):
        env.unwrapped.step(env.action_space.sample())


def test_a_seed_repeats_the_episode():
    def play(seed):
        env = gymnasium.make(FALLING)
        frames = [env.reset(seed=seed)[0]]
        frames += [env.step(np.float32([action]))[0] for action in (1, -1, 0, 1, 1)]
        return np.stack(frames)

    assert np.array_equal(play(3), play(3))
    assert not np.array_equal(play(3), play(4))
    env = gymnasium.make(FALLING)
    first, second = env.reset(seed=3)[0], env.reset()[0]
    assert np.array_equal(first, env.reset(seed=3)[0]) and not np.array_equal(first, second)


def test_frames_may_be_stacked_and_have_their_channels_first():
    shapes = {}
    for stack in (1, 3):
        for last in (True, False):
            env = gymnasium.make("hksl/reacher-easy-v0", frame_stack=stack, channels_last=last)
            first, _ = env.reset(seed=1)
            later = env.step(np.float32([1, -1]))[0]
            shapes[stack, last] = first.shape
            if stack == 3:
                first, later = (a if not last else np.moveaxis(a, -1, 0) for a in (first, later))
                # Oldest first; an episode begins with its first frame repeated.
                assert np.array_equal(first[:3], first[6:]) and np.array_equal(later[:6], first[3:])
                assert not np.array_equal(later[6:], first[6:])
    assert shapes == {
        (1, True): (84, 84, 3),
        (1, False): (3, 84, 84),
        (3, True): (84, 84, 9),
        (3, False): (9, 84, 84),
    }


def test_info_is_the_ground_truth():
    env = gymnasium.make(FALLING)
    frame, info = env.reset(seed=2)
    column = int(info["agent_column"])
    # The configuration's border of four pixels; the agent is in the bottom row.
    assert frame.shape == (43, 23, 1) and frame[38, 4 + column, 0] == 255
    assert info["pixel_row"].shape == (15,)
    env = gymnasium.make("hksl/cartpole-swingup-v0")
    assert env.reset(seed=2)[1]["cart"].shape == (3,)


def test_render_gives_colours():
    env = gymnasium.make(FALLING, render_mode="rgb_array", channels_last=False)
    frame, _ = env.reset(seed=1)
    picture = env.render()
    assert picture.shape == (43, 23, 3) and np.array_equal(picture[..., 1], frame[0])
    assert env.metadata["render_fps"] == 10
    env = gymnasium.make("hksl/cartpole-swingup-v0", render_mode="rgb_array")
    assert env.metadata["render_fps"] == round(1000 / 80)


def test_settings_and_distractors_change_the_frames():
    def first(**arguments):
        return gymnasium.make("hksl/cartpole-swingup-v0", **arguments).reset(seed=1)[0]

    plain = first()
    assert not np.array_equal(plain, first(distractor="color-easy"))
    assert first(config={"environment": {"height": 60, "width": 70}}).shape == (60, 70, 3)


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"distractor": "color-easy"}, "falling-pixels has no distractors"),
        ({"distractor": "colour"}, "unknown distractor `colour` (distractor)"),
        ({"config": {"environment.hight": 3}}, "did you mean `environment.height`"),
        ({"config": {"environment.height": 3}}, "15×15"),
        ({"config": {"environment.height": object()}}, "of type object"),
        ({"config": "no"}, "not a dictionary"),
        ({"preset": "fast"}, "unknown preset `fast`"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"frame_stack": 0}, "at least 1"),
    ],
)
def test_wrong_arguments_are_told(arguments, words):
    with pytest.raises(hksl.ConfigError) as raised:
        hksl.HkslEnv("falling-pixels", **arguments)
    assert words in str(raised.value)


def test_an_unknown_task_is_told_with_its_neighbours():
    with pytest.raises(hksl.ConfigError, match="did you mean `cartpole-swingup`"):
        hksl.HkslEnv("cartpole-swing")


@pytest.mark.parametrize(
    "action, error",
    [
        (np.float32([0.1, 0.2]), hksl.ArrayError),
        (np.float32([np.nan]), hksl.ArrayError),
        (np.float32(0.5), hksl.ArrayError),
    ],
)
def test_wrong_actions_are_told_and_change_nothing(action, error):
    env = hksl.HkslEnv("falling-pixels")
    env.reset(seed=1)
    with pytest.raises(error):
        env.step(action)
    other = hksl.HkslEnv("falling-pixels")
    other.reset(seed=1)
    right = np.float32([1.0])
    assert np.array_equal(env.step(right)[0], other.step(right)[0])


def test_a_closed_environment_is_told():
    env = hksl.HkslEnv("falling-pixels")
    env.reset(seed=1)
    env.close()
    env.close()
    for call in (env.reset, lambda: env.step(np.float32([0]))):
        with pytest.raises(hksl.TaskError, match="closed"):
            call()


def test_another_thread_is_refused():
    env = hksl.HkslEnv("falling-pixels")
    env.reset(seed=1)
    caught = []

    def use():
        for call in (env.reset, lambda: env.step(np.float32([0]))):
            try:
                call()
            except hksl.BusyError as error:
                caught.append(str(error))

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()
    assert len(caught) == 2 and "make one in each thread" in caught[0]
    env.step(np.float32([0]))


@pytest.mark.parametrize("mode", ["sync", "async"])
@pytest.mark.parametrize("task", ["falling-pixels", "cartpole-swingup"])
def test_environments_run_side_by_side(task, mode):
    arguments = {"context": "spawn"} if mode == "async" else {}
    vector = gymnasium.make_vec(
        f"hksl/{task}-v0", num_envs=2, vectorization_mode=mode, vector_kwargs=arguments
    )
    observations, infos = vector.reset(seed=[1, 2])
    assert observations.shape[0] == 2 and not np.array_equal(*observations)
    observations, rewards, *_ = vector.step(vector.action_space.sample())
    alone = gymnasium.make(f"hksl/{task}-v0")
    assert alone.reset(seed=1)[0].shape == observations.shape[1:]
    vector.close()
