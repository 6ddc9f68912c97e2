"""What Python costs: an environment's step and a learning step, here and in the command line.

    target/python/bin/python crates/hksl-py/benches/overhead.py

Both run on this machine one after the other, with the package's own `hksl`. Medians.
"""

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

import gymnasium
import hksl
import numpy as np

COMMAND = str(Path(sys.executable).with_name("hksl"))
STEPS, UPDATES = 20_000, 20


def command_line(*arguments):
    printed = subprocess.run([COMMAND, "bench", *arguments, "--json"], check=True, capture_output=True, text=True)
    return json.loads(printed.stdout)


def median_seconds(call, runs):
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def step_seconds(task, **arguments):
    env = gymnasium.make(f"hksl/{task}-v0", **arguments)
    actions = [env.action_space.sample() for _ in range(64)]
    env.reset(seed=1)
    count = 0

    def step():
        nonlocal count
        count += 1
        return env.step(actions[count % 64])

    times = []
    while len(times) < STEPS:
        began = time.perf_counter()
        _, _, terminated, truncated, _ = step()
        times.append(time.perf_counter() - began)
        if terminated or truncated:
            env.reset()
    return statistics.median(times)


def update_seconds(task, preset):
    env = gymnasium.make(f"hksl/{task}-v0", frame_stack=3, channels_last=False)
    agent = hksl.Agent(
        observation_shape=env.observation_space.shape,
        action_dims=env.action_space.shape[0],
        preset=preset,
        config=SETTINGS,
    )
    observation, _ = env.reset(seed=1)
    agent.begin(observation)
    done = False
    while not done:
        action = env.action_space.sample()
        observation, reward, terminated, done, _ = env.step(action)
        agent.observe(action, reward, observation, terminated, done)
    assert agent.update() is not None
    return median_seconds(agent.update, UPDATES)


#: Those of `configs/tasks/falling-pixels.toml`, which a task of one's own does not have.
SETTINGS = {"hksl.skips": [1, 3, 5], "training.initial_random_steps": 0}


def main():
    rust = command_line("render", "falling-pixels", "--runs", str(STEPS))["median_s"]
    print(f"step of falling-pixels, Rust      {1e6 * rust:8.2f} µs")
    for name, arguments in [("single frames", {}), ("three stacked", {"frame_stack": 3})]:
        python = step_seconds("falling-pixels", **arguments)
        print(f"  Python, {name:<15}         {1e6 * python:8.2f} µs, {1e6 * (python - rust):.2f} µs above")
    native = hksl.HkslEnv("falling-pixels")
    native.reset(seed=1)
    frame = median_seconds(native._native.frame, STEPS)
    print(f"  of which one frame as an array  {1e6 * frame:8.2f} µs")
    for preset in ("small", "paper"):
        rust = command_line("step", "falling-pixels", "--preset", preset, "--runs", str(UPDATES))["median_s"]
        python = update_seconds("falling-pixels", preset)
        print(f"learning step, preset {preset:<6} Rust {1e3 * rust:8.2f} ms, Python {1e3 * python:8.2f} ms")


if __name__ == "__main__":
    np.random.seed(1)
    main()
