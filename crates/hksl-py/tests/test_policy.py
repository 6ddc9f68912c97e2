"""Policies: acting, encoding, exporting."""

import re
import threading
from pathlib import Path

import gymnasium
import hksl
import numpy as np
import pytest
import torch

PAGE = Path(__file__).resolve().parents[3] / "docs" / "python.md"


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Runs of the preset `debug`, by method."""
    runs = tmp_path_factory.mktemp("runs")
    made = {}

    def of(method="hksl", **arguments):
        key = (method, str(arguments))
        if key not in made:
            training = hksl.train(
                "falling-pixels", method=method, preset="debug", runs=runs / str(len(made)), progress=False, **arguments
            )
            made[key] = training.folder
        return made[key]

    return of


def observations(policy, count=5):
    random = np.random.default_rng(1)
    return random.integers(0, 256, (count, *policy.observation_shape), np.uint8)


def test_observations_may_have_their_axes_in_any_documented_order(trained):
    policy = hksl.load(trained())
    assert (policy.observation_shape, policy.frame_shape, policy.frame_stack) == ((3, 43, 23), (1, 43, 23), 3)
    one = observations(policy)[0]
    action = policy.act(one)
    assert action.dtype == np.float32 and action.shape == policy.action_shape == (1,) and abs(action[0]) <= 1
    last = np.ascontiguousarray(np.moveaxis(one, 0, -1))
    for other in (last, one[:, None], one[..., None], one[:, ::-1][:, ::-1], np.asfortranarray(one)):
        assert np.array_equal(policy.act(other), action)
    batch = observations(policy)
    latents = policy.encode(batch)
    assert all(values.shape == (5, 8) and values.dtype == np.float32 for values in latents.values())
    for name, values in policy.encode(np.moveaxis(batch, 1, -1)).items():
        assert np.array_equal(values, latents[name])
    assert [np.array_equal(policy.encode(batch[2:3])[name][0], values[2]) for name, values in latents.items()] == [
        True
    ] * len(latents)


def test_an_empty_batch_has_no_latents_and_many_have_many(trained):
    policy = hksl.load(trained())
    assert policy.encode(observations(policy, 0)) == {}
    assert all(len(values) == 150 for values in policy.encode(observations(policy, 150)).values())


def test_actions_are_deterministic_unless_sampled(trained):
    policy = hksl.load(trained())
    one = observations(policy)[0]
    assert np.array_equal(policy.act(one), hksl.load(trained()).act(one))
    assert len({float(policy.act(one, deterministic=False)[0]) for _ in range(5)}) == 5


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((9, 84, 84), np.uint8),
        np.zeros((3, 43, 23), np.float32),
        np.zeros((1, 3, 43, 23), np.uint8),
        np.zeros((), np.uint8),
        "frame",
    ],
)
def test_wrong_observations_are_told(trained, array):
    policy = hksl.load(trained())
    with pytest.raises(hksl.ArrayError) as raised:
        policy.act(array)
    assert "expected uint8 observations of 3 stacked frames, oldest first, (3, 43, 23)" in str(raised.value)


def test_what_is_no_run_is_told(tmp_path, trained):
    with pytest.raises(hksl.RunError):
        hksl.load(tmp_path)
    with pytest.raises(hksl.RunError, match="no checkpoint at environment step 7; available: 0, 240"):
        hksl.load(trained(), checkpoint=7)
    with pytest.raises(hksl.ConfigError):
        hksl.load(trained(), device="gpu")


def test_it_acts_in_its_task(trained):
    policy = hksl.load(trained())
    env = gymnasium.make("hksl/falling-pixels-v0", frame_stack=policy.frame_stack)
    observation, _ = env.reset(seed=1)
    total = 0.0
    while True:
        observation, reward, terminated, truncated, _ = env.step(policy.act(observation))
        total += reward
        if terminated or truncated:
            break
    assert total >= 0


def module():
    """The PyTorch module of the book."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    code = next(block for block in blocks if "nn.Module" in block)
    assert len(code.splitlines()) <= 50
    names = {}
    exec(compile(code, str(PAGE), "exec"), names)
    return names["Policy"]


@pytest.mark.parametrize(
    "method, arguments",
    [
        ("hksl", {}),
        ("hksl", {"ablation": "shared-encoder"}),
        ("sac", {}),
        ("drq", {}),
        ("curl", {}),
        ("dbc", {}),
        ("pi-sac", {}),
    ],
)
def test_the_books_module_gives_the_same_actions(trained, tmp_path, method, arguments):
    policy = hksl.load(trained(method, **arguments))
    policy.export(tmp_path / "policy.safetensors")
    batch = observations(policy, 20)
    with torch.no_grad():
        actions = module()(tmp_path / "policy.safetensors")(torch.from_numpy(batch)).numpy()
    assert np.abs(actions - np.stack([policy.act(one) for one in batch])).max() < 1e-5


def test_an_exported_policy_knows_the_bounds_of_its_actions(tmp_path, dot, short):
    training = hksl.train(dot, preset="debug", config=short, runs=tmp_path / "runs", progress=False)
    policy = hksl.load(training.folder)
    policy.export(tmp_path / "policy.safetensors")
    batch = observations(policy, 10)
    with torch.no_grad():
        actions = module()(tmp_path / "policy.safetensors")(torch.from_numpy(batch)).numpy()
    own = np.stack([policy.act(one) for one in batch])
    assert np.abs(actions - own).max() < 1e-5 and (own[:, 1] > 1).any()


def test_a_recurrent_policy_forgets_on_reset(trained):
    policy = hksl.load(trained("dreamer-v2"))
    one, two = observations(policy, 2)
    first = policy.act(one)
    policy.act(two)
    assert not np.array_equal(policy.act(one), first)
    policy.reset()
    assert np.array_equal(policy.act(one), first)


def test_threads_that_use_one_policy_are_told(trained):
    policy = hksl.load(trained())
    batch = observations(policy, 400)
    expected = policy.encode(batch)
    results = []

    def encode():
        try:
            results.append(all(np.array_equal(values, expected[name]) for name, values in policy.encode(batch).items()))
        except hksl.BusyError as error:
            results.append(str(error))

    threads = [threading.Thread(target=encode) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results.count(True) >= 1 and all(result is True or "another thread" in result for result in results)
