"""Training in tasks of hksl and in environments of other people."""

import csv
import json
import signal
from pathlib import Path

import gymnasium
import hksl
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.wrappers import AddRenderObservation, FrameStackObservation, ResizeObservation
from safetensors.numpy import load_file


def train(environment, runs, short, **arguments):
    settings = {**short, **arguments.pop("config", {})}
    arguments = {"preset": "debug", "progress": False, "runs": runs, **arguments}
    return hksl.train(environment, config=settings, **arguments)


def rows(folder):
    with open(Path(folder) / "eval.csv", newline="") as file:
        return list(csv.DictReader(file))


def replay(folder):
    """All stored episodes, oldest first."""
    return [load_file(file) for file in sorted((Path(folder) / "replay").glob("*.safetensors"))]


def stop_at(step, act):
    """A function that watches a run and acts once it has come that far."""

    def watch(event, figures):
        if event == "stepped" and figures["environment_step"] >= step and not watch.done:
            watch.done = True
            act()

    watch.done = False
    return watch


def pendulum():
    env = gymnasium.make("Pendulum-v1", render_mode="rgb_array")
    return ResizeObservation(AddRenderObservation(env), (36, 36))


def test_pendulum_is_interrupted_resumed_and_its_policy_loads(runs, short):
    interrupt = stop_at(100, lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        train(pendulum, runs, short, progress=interrupt)
    folder = runs / "Pendulum-v1" / "hksl-debug" / "seed-1"
    assert not (folder / "done").exists() and not (folder / "failed").exists()
    assert (folder / "tensorboard").is_dir() and (folder / "metrics.jsonl").is_file()

    events = []
    training = train(pendulum, runs, short, progress=lambda event, figures: events.append((event, figures)))
    names = [event for event, _ in events]
    started = dict(events)["started"]
    assert 100 <= started["resumed_at"] < 160 and "new_episode" in names
    assert training.folder == folder and (folder / "done").is_file()
    assert (training.ending, training.environment_step) == ("done", 160)
    assert [int(row["environment_step"]) for row in rows(folder)] == [0, 80, 160]
    assert train(pendulum, runs, short).ending == "done before"
    assert (folder / "command.txt").read_text().startswith("hksl.train(Pendulum-v1, ")

    policy = hksl.load(training.folder)
    assert (policy.task, policy.method, policy.environment_step) == ("Pendulum-v1", "hksl", 160)
    env = FrameStackObservation(pendulum(), policy.frame_stack)
    observation, _ = env.reset(seed=1)
    action = policy.act(observation)
    assert action.shape == (1,) and env.action_space.contains(action)
    latents = policy.encode(observation[None])
    assert [values.shape for values in latents.values()] == [(1, 8)] * 2


def test_actions_arrive_in_their_bounds_and_frames_with_their_seeds(runs, short, dot):
    train(dot, runs, short)
    # The first one has measured memory.
    first = dot.made[1]
    actions = np.stack(first.actions)
    assert actions.dtype == np.float32 and actions.shape == (160, 2)
    low, high = first.action_space.low, first.action_space.high
    assert np.all(actions >= low) and np.all(actions <= high)
    assert np.all(np.ptp(actions, axis=0) > 0.8 * (high - low))
    assert len(set(first.seeds)) == len(first.seeds) > 5
    # One to measure memory, one for training, one for each evaluation; all are closed.
    assert len(dot.made) == 5 and all(env.closed for env in dot.made)
    again = [list(env.seeds) for env in dot.made]
    dot.made = []
    train(dot, runs / "again", short)
    assert [env.seeds for env in dot.made] == again


def test_terminated_is_terminal_and_truncated_is_not(runs, short, dot):
    training = train(lambda: dot(limit=12), runs, short)
    ends = {"terminated": 0, "truncated": 0}
    for episode in replay(training.folder):
        terminal = episode["terminal"]
        assert not terminal[:-1].any()
        ends["terminated" if terminal[-1] else "truncated"] += 1
        assert terminal[-1] or len(terminal) == 12
    assert min(ends.values()) > 0


def test_channels_may_be_first_last_or_absent(runs, short, dot):
    for number, shape in enumerate([(16, 20, 3), (3, 16, 20), (16, 20, 1), (16, 20)]):

        class Shaped(dot):
            def frame(self):
                frame = np.zeros((16, 20), np.uint8)
                frame[3, 5] = 77
                missing = {3: 0 if self.shape[0] == 3 else -1}.get(len(self.shape))
                frame = frame if missing is None else np.expand_dims(frame, missing)
                return np.ascontiguousarray(np.broadcast_to(frame, self.shape))

        training = train(lambda: Shaped(shape), runs, short, name=f"shape-{number}")
        frames = replay(training.folder)[0]["frames"]
        assert frames.shape[1:] == (3 if 3 in shape else 1, 16, 20)
        assert (frames[:, :, 3, 5] == 77).all() and frames.astype(int).sum() == 77 * len(frames) * frames.shape[1]


def test_an_exception_saves_the_run_and_arrives_as_it_was(runs, short, dot):
    class Broken(Exception):
        pass

    error = Broken("the robot fell over")

    class Breaks(dot):
        count = 0

        def step(self, action):
            Breaks.count += 1
            if Breaks.count == 140:
                raise error
            return super().step(action)

    with pytest.raises(Broken) as raised:
        train(Breaks, runs, short, task="dot")
    assert raised.value is error
    folder = runs / "dot" / "hksl-debug" / "seed-1"
    assert "the robot fell over" in (folder / "failed").read_text()
    steps = sorted(path.name for path in (folder / "checkpoints").iterdir())
    events = []
    training = train(dot, runs, short, task="dot", progress=lambda name, figures: events.append((name, figures)))
    assert dict(events)["started"]["resumed_at"] == int(steps[-1].removeprefix("step-")) > 80
    assert training.ending == "done" and not (folder / "failed").exists()


def test_a_factory_that_fails_is_raised_as_it_was(runs, short, dot):
    def fails_later():
        if dot.made:
            raise LookupError("no second licence")
        return dot()

    with pytest.raises(LookupError, match="no second licence"):
        train(fails_later, runs, short)
    assert all(env.closed for env in dot.made)


def test_what_an_environment_must_not_return_is_told(runs, short, dot):
    class Nan(dot):
        def reward(self):
            return float("nan") if self.steps == 4 else 0.0

    class Grows(dot):
        def frame(self):
            frame = super().frame()
            return frame if self.steps < 4 else np.repeat(frame, 2, axis=0)

    class Floats(dot):
        def frame(self):
            return super().frame().astype(np.float32)

    class Old(dot):
        def step(self, action):
            return super().step(action)[:4]

    for env, kind, words in [
        (Nan, hksl.TaskError, "reward NaN in step 4"),
        (Grows, hksl.TaskError, "[32, 16, 3], but its observation space has shape [16, 16, 3]"),
        (Floats, hksl.ArrayError, "float32; expected uint8 frames"),
        (Old, hksl.TaskError, "terminated, truncated"),
    ]:
        with pytest.raises(kind) as raised:
            train(env, runs, short, task=env.__name__)
        assert words in str(raised.value)
        assert all(made.closed for made in dot.made)


BOX = spaces.Box(0, 255, (16, 16, 3), np.uint8)


@pytest.mark.parametrize(
    "spaces_, words",
    [
        ({"action_space": spaces.Discrete(4)}, "action space of Dot is Discrete(4)"),
        ({"action_space": spaces.MultiBinary(2)}, "expected a Box"),
        ({"action_space": spaces.Box(-np.inf, np.inf, (2,), np.float32)}, "RescaleAction"),
        ({"action_space": spaces.Box(0, 5, (2,), np.int64)}, "Box of int64"),
        ({"observation_space": spaces.Box(-1, 1, (4,), np.float32)}, "AddRenderObservation"),
        ({"observation_space": spaces.Dict(image=BOX)}, "expected a Box of images"),
        ({"observation_space": spaces.Box(0, 1, (16, 16, 3), np.float32)}, "TransformObservation"),
        ({"observation_space": spaces.Box(0, 255, (14, 84, 3), np.uint8)}, "ResizeObservation"),
        ({"observation_space": spaces.Box(0, 255, (84, 84, 9), np.uint8)}, "leave frame stacking"),
    ],
)
def test_unsuitable_spaces_are_refused_before_anything_is_written(runs, short, dot, spaces_, words):
    with pytest.raises(hksl.ConfigError) as raised:
        train(lambda: dot(**spaces_), runs, short)
    assert words in str(raised.value)
    assert not runs.exists() and all(env.closed for env in dot.made)


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"method": "ppo"}, "unknown method `ppo` (method)"),
        ({"config": {"environment.height": 84}}, "hksl does not resize frames"),
        ({"config": {"environment_steps": -1}}, "environment_steps = -1 (config)"),
        ({"config": {"sac.batch": 1}}, "did you mean"),
        ({"config": {"sac.batch_size": [1, "a"]}}, "wrong type"),
        ({"environment_steps": "many"}, "not a whole number"),
        ({"environment_steps": 1.5}, "not a whole number"),
        ({"seed": -1}, "seed"),
        ({"distractor": "color-easy"}, "distractors change control tasks only"),
        ({"task": "cartpole-swingup"}, "a task of hksl has this name"),
        ({"task": "a/b"}, "names a folder"),
        ({"name": "no-c"}, "name of an ablation"),
        ({"resume": "maybe"}, "'auto' or 'never'"),
        ({"ablation": "h3"}, "falling-pixels alone"),
    ],
)
def test_wrong_arguments_are_told(runs, short, dot, arguments, words):
    with pytest.raises(hksl.ConfigError) as raised:
        train(dot, runs, short, **arguments)
    assert words in str(raised.value)
    assert not runs.exists()


def test_what_makes_no_environment_is_told(runs, short, dot):
    for environment, words in [
        (dot(), "pass a function"),
        (lambda: 3, "lacks reset"),
        ("cartpole", "did you mean `cartpole-swingup`"),
    ]:
        with pytest.raises(hksl.ConfigError, match=words):
            train(environment, runs, short)
    assert not runs.exists()


def test_a_time_limit_is_needed_and_may_be_set(runs, short, dot):
    def endless():
        env = dot()
        del env.steps_per_episode
        env.limit = 10**9
        env.action_space = spaces.Box(-0.01, 0.01, (2,), np.float32)
        return env

    with pytest.raises(hksl.ConfigError, match="no time limit"):
        train(endless, runs, short, preset="small")
    # The preset debug truncates episodes after 80 steps.
    training = train(endless, runs, short, config={"environment.episode_steps": 40})
    assert all(len(episode["rewards"]) == 40 for episode in replay(training.folder))
    assert not any(episode["terminal"].any() for episode in replay(training.folder))


def test_a_run_of_other_settings_is_not_touched(runs, short, dot):
    training = train(dot, runs, short, task="dot")
    before = (training.folder / "eval.csv").read_bytes()
    with pytest.raises(hksl.ConfigError, match="sac.batch_size is 8 in that run, not 4"):
        train(dot, runs, short, task="dot", config={"sac.batch_size": 4})
    with pytest.raises(hksl.ConfigError, match="already exists"):
        train(dot, runs, short, task="dot", resume="never")
    assert (training.folder / "eval.csv").read_bytes() == before


def test_the_callers_exception_stops_and_saves(runs, short, dot):
    def fail():
        raise RuntimeError("no room on the screen")

    with pytest.raises(RuntimeError, match="no room"):
        train(dot, runs, short, progress=stop_at(100, fail))
    assert train(dot, runs, short).ending == "done"


def test_an_interrupted_task_of_hksl_resumes_bit_for_bit(runs, short):
    whole = train("falling-pixels", runs / "whole", short, config={"environment.episode_steps": 40})
    with pytest.raises(KeyboardInterrupt):
        train(
            "falling-pixels",
            runs / "parts",
            short,
            config={"environment.episode_steps": 40},
            progress=stop_at(100, lambda: signal.raise_signal(signal.SIGINT)),
        )
    parts = train("falling-pixels", runs / "parts", short, config={"environment.episode_steps": 40})
    weights = [run.folder / "checkpoints/step-000000160/weights.safetensors" for run in (whole, parts)]
    assert weights[0].read_bytes() == weights[1].read_bytes()


def test_every_method_trains_on_a_brought_environment(runs, short, dot):
    for method in hksl.methods():
        training = train(lambda: dot(limit=30), runs, short, method=method)
        policy = hksl.load(training.folder)
        assert policy.act(np.zeros(policy.observation_shape, np.uint8)).shape == (2,)


def test_info_is_probed_by_its_keys(runs, short, dot):
    training = train(dot, runs, short)
    arguments = {"horizons": [1], "train_episodes": 6, "test_episodes": 3}
    table = hksl.probe(training.folder, dot, ["place", "pair"], **arguments)
    assert [row["encoder"] for row in table][-1] == "all"
    for row in table:
        assert row["horizon"] == 1 and len(row["mse_by_coordinate"]) == 3
        assert np.isfinite([row["mse"], row["constant_mse"]]).all()
    # The dot's column is in the image, and even random encoders know it.
    assert min(row["mse"] for row in table) < table[0]["constant_mse"]
    own = hksl.probe(training.folder, dot, ["place"], policy="run", **arguments)
    assert own[0]["mse"] != table[0]["mse"]
    for keys, words in [(["plaec"], "it has 'name', 'pair', 'place'"), (["name"], "not numeric"), ([], "no keys")]:
        with pytest.raises(hksl.ConfigError, match=words):
            hksl.probe(training.folder, dot, keys, **arguments)
    with pytest.raises(hksl.ArrayError, match="those of the run"):
        hksl.probe(training.folder, lambda: dot((20, 16, 3)), ["place"], **arguments)


def test_environment_json_says_what_the_environment_is(runs, short, dot):
    training = train(dot, runs, short)
    facts = json.loads((training.folder / "environment.json").read_text())
    assert facts["specification"]["frame"] == {"channels": 3, "height": 16, "width": 16}
    assert facts["interface"]["high"] == [2.0, 6.0]
