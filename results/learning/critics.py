#!/usr/bin/env python3
"""What the critics of a run on Falling Pixels know: of episodes they were trained on and of new ones, and of the action.

    python3 results/learning/critics.py RUNS/falling-pixels/hksl-orth/seed-1@10000 ... --out critics.csv

Each argument is a run's folder and an environment step at which it kept its weights (frames with a border of 4, any
number of levels, or a model-free baseline). The task is stated again here, independent of hksl. A row a critic:

  replayed_error, new_error   mean squared n-step TD error, with the online critic's value at its end, over the 20
                              episodes that the replay got last before that step, and over 20 new ones by the same
                              policy. Where the second is larger, the critic has learnt the replay by heart.
  q_spread            root of the mean variance of Q over the moves -1, 0, 1 at 800 states that the policy reaches
  true_spread         the same of the true effect: the mean discounted return of 30 steps of the policy after each move,
                      6 rollouts with the same random numbers for the three moves
  correlation         of Q with the true effect, each minus its state's mean (standard error 0.025); `sum` is what the
                      actor maximises
  reliability         correlation of two halves of the rollouts: the most that could be seen

Needs torch, numpy and safetensors; about two minutes a checkpoint on one core.
"""

import argparse
import csv
import pathlib
import sys

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.numpy import load_file

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE))
sys.dont_write_bytecode = True
from supervised import COLUMNS, EPISODE_STEPS, MOVES, ROWS, SPAWN_PROBABILITY, SPEEDS  # noqa: E402

BORDER, DISCOUNT, SKIPS = 4, 0.99, (1, 3, 5, 7)
EPISODES, STATES, WARM_UP, ROLLOUTS, HORIZON = 20, 800, 120, 6, 30
LOG_STD_LOW, LOG_STD_HIGH = -10.0, 2.0


class Agent:
    """The networks of a checkpoint's weights, without targets."""

    def __init__(self, path):
        self.weights = {name: torch.from_numpy(tensor.copy()) for name, tensor in load_file(path).items()}
        self.model_free = "encoder.linear.weight" in self.weights
        self.critics = sum(name.endswith("q1.0.weight") for name in self.weights)

    def linear(self, name, x):
        return F.linear(x, self.weights[f"{name}.weight"], self.weights[f"{name}.bias"])

    def features(self, name, observations):
        x = observations.float() / 255
        for layer in range(4):
            weight, bias = (self.weights[f"{name}.convs.{layer}.{part}"] for part in ("weight", "bias"))
            x = F.relu(F.conv2d(x, weight, bias, stride=2 if layer == 0 else 1))
        return x.permute(0, 2, 3, 1).flatten(1)

    def head(self, name, features):
        scale, shift = self.weights[f"{name}.norm.weight"], self.weights[f"{name}.norm.bias"]
        return F.layer_norm(self.linear(f"{name}.linear", features), scale.shape, scale, shift)

    def mlp(self, name, x):
        for layer in (0, 2):
            x = F.relu(self.linear(f"{name}.{layer}", x))
        return self.linear(f"{name}.4", x)

    def encode(self, observations):
        """Each critic's latents, and what the actor reads."""
        if self.model_free:
            features = self.features("encoder", observations)
            latents = self.head("encoder", features)
            own = "actor.head.linear.weight" in self.weights
            return [latents], self.head("actor.head", features) if own else latents
        names = [f"levels.{level}.encoder" for level in range(self.critics)]
        latents = [self.head(name, self.features(name, observations)) for name in names]
        return latents, torch.cat(latents, 1)

    def act(self, read, noise):
        mean, raw = self.mlp("actor.trunk", read).chunk(2, 1)
        log_std = LOG_STD_LOW + (LOG_STD_HIGH - LOG_STD_LOW) / 2 * (torch.tanh(raw) + 1)
        return torch.tanh(mean + log_std.exp() * noise)

    def q(self, critic, latents, actions):
        name = "critic" if self.model_free else f"critics.{critic}"
        joined = torch.cat([latents[critic], actions], 1)
        return self.mlp(f"{name}.q1", joined), self.mlp(f"{name}.q2", joined)


class Episodes:
    """Many episodes side by side, their last three frames stacked."""

    def __init__(self, count, rng):
        self.count, self.rng = count, rng
        self.agent = rng.integers(COLUMNS, size=count)
        self.rows, self.speeds = np.zeros((count, COLUMNS), int), rng.choice(SPEEDS, (count, COLUMNS))
        self.frames = [self.frame()] * 3

    def repeated(self, times, seed):
        """Each episode `times` times over, drawing from a generator of its own."""
        copy = Episodes(0, np.random.default_rng(seed))
        copy.count = self.count * times
        copy.agent, copy.rows, copy.speeds = (np.repeat(x, times, 0) for x in (self.agent, self.rows, self.speeds))
        copy.frames = [np.repeat(frame, times, 0) for frame in self.frames]
        return copy

    def frame(self):
        frame = np.zeros((self.count, ROWS + 2 * BORDER, COLUMNS + 2 * BORDER), np.uint8)
        which, column = np.nonzero(self.rows >= 0)
        frame[which, self.rows[which, column] + BORDER, column + BORDER] = 255
        frame[np.arange(self.count), ROWS - 1 + BORDER, self.agent + BORDER] = 255
        return frame

    def observations(self):
        return torch.from_numpy(np.stack(self.frames, 1))

    def step(self, actions):
        empty = self.rows < 0
        self.rows = np.where(empty, -1, np.minimum(self.rows + self.speeds, ROWS - 1))
        self.landed = self.rows == ROWS - 1
        move = (actions > 1 / 3).astype(int) - (actions < -1 / 3).astype(int)
        self.agent = np.clip(self.agent + move, 0, COLUMNS - 1)
        rewards = self.landed[np.arange(self.count), self.agent].astype(np.float32)
        self.rows[self.landed] = -1
        new = empty & (self.rng.random((self.count, COLUMNS)) < SPAWN_PROBABILITY)
        self.rows[new], self.speeds[new] = 0, self.rng.choice(SPEEDS, new.sum())
        self.frames = self.frames[1:] + [self.frame()]
        return rewards


def new_episodes(agent):
    episodes, noise = Episodes(EPISODES, np.random.default_rng(1)), torch.Generator().manual_seed(1)
    observations, actions, rewards = [episodes.observations()], [], []
    for _ in range(EPISODE_STEPS):
        actions.append(agent.act(agent.encode(observations[-1])[1], torch.randn(EPISODES, 1, generator=noise)))
        rewards.append(episodes.step(actions[-1][:, 0].numpy()))
        observations.append(episodes.observations())
    return torch.stack(observations, 1), torch.stack(actions, 1), torch.from_numpy(np.stack(rewards, 1))


def replayed_episodes(run, step):
    last = step // EPISODE_STEPS
    episodes = []
    for number in range(max(last - EPISODES, 0), last):
        saved = load_file(run / "replay" / f"episode-{number:09d}.safetensors")
        frames, times = saved["frames"][:, 0], np.arange(len(saved["frames"]))
        stacks = np.stack([frames[np.maximum(times - age, 0)] for age in (2, 1, 0)], 1)
        episodes.append([torch.from_numpy(part) for part in (stacks, saved["actions"], saved["rewards"])])
    return [torch.stack(parts) for parts in zip(*episodes)]


def td_errors(agent, episodes):
    noise = torch.Generator().manual_seed(0)
    errors = [[] for _ in range(agent.critics)]
    for observations, actions, rewards in zip(*episodes):
        latents, read = agent.encode(observations)
        for critic, found in enumerate(errors):
            n = SKIPS[critic]
            start = torch.arange(len(rewards) - n)
            after = agent.act(read[start + n], torch.randn(len(start), 1, generator=noise))
            value = torch.minimum(*agent.q(critic, [latent[start + n] for latent in latents], after))[:, 0]
            target = sum(DISCOUNT**step * rewards[start + step] for step in range(n)) + DISCOUNT**n * value
            both = agent.q(critic, [latent[start] for latent in latents], actions[start])
            found.append(sum((q[:, 0] - target).square() for q in both) / 2)
    return [torch.cat(found).mean().item() for found in errors]


def centred(effects):
    return effects - effects.mean(1, keepdims=True)


def true_effects(agent):
    """Observations `(S, 3, H, W)` and discounted returns `(S, moves, rollouts)`."""
    states, noise = Episodes(STATES, np.random.default_rng(3)), torch.Generator().manual_seed(3)
    for _ in range(WARM_UP):
        read = agent.encode(states.observations())[1]
        states.step(agent.act(read, torch.randn(STATES, 1, generator=noise))[:, 0].numpy())
    returns = np.zeros((STATES, len(MOVES), ROLLOUTS))
    for index, move in enumerate(MOVES):
        rollouts, noise = states.repeated(ROLLOUTS, 4), torch.Generator().manual_seed(4)
        actions = np.full(rollouts.count, float(move))
        for step in range(HORIZON):
            returns[:, index] += DISCOUNT**step * rollouts.step(actions).reshape(STATES, ROLLOUTS)
            read = agent.encode(rollouts.observations())[1]
            actions = agent.act(read, torch.randn(rollouts.count, 1, generator=noise))[:, 0].numpy()
    return states.observations(), returns


def correlation(a, b):
    return np.corrcoef(a.ravel(), b.ravel())[0, 1]


@torch.no_grad()
def rows(run, step):
    agent = Agent(run / "checkpoints" / f"step-{step:09d}" / "weights.safetensors")
    replayed, new = td_errors(agent, replayed_episodes(run, step)), td_errors(agent, new_episodes(agent))
    observations, returns = true_effects(agent)
    truth = centred(returns.mean(2))
    half = ROLLOUTS // 2
    reliability = correlation(centred(returns[:, :, :half].mean(2)), centred(returns[:, :, half:].mean(2)))
    latents, _ = agent.encode(observations)
    effects = []
    for critic in range(agent.critics):
        by_move = [sum(agent.q(critic, latents, torch.full((STATES, 1), float(move)))) / 2 for move in MOVES]
        effects.append(centred(torch.cat(by_move, 1).numpy()))
    named = [(str(critic + 1), q, replayed[critic], new[critic]) for critic, q in enumerate(effects)]
    if agent.critics > 1:
        named.append(("sum", sum(effects), None, None))
    for critic, q, replayed_error, new_error in named:
        yield {"agent": run.parent.name, "seed": run.name.removeprefix("seed-"), "environment_step": step,
               "critic": critic, "replayed_error": replayed_error, "new_error": new_error, "q_spread": q.std(),
               "true_spread": truth.std(), "correlation": correlation(q, truth), "reliability": reliability}


def judge(description, out, rows):
    """The command line: the rows of each checkpoint that it names, printed and written as they come."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="RUN@STEP")
    parser.add_argument("--out", type=pathlib.Path, default=HERE / out)
    options = parser.parse_args()
    torch.set_num_threads(1)
    found = []
    for argument in options.runs:
        run, _, step = argument.rpartition("@")
        for row in rows(pathlib.Path(run), int(step)):
            found.append({name: f"{x:.4f}" if isinstance(x, (float, np.floating)) else x for name, x in row.items()})
            print(found[-1], flush=True)
            with open(options.out, "w", newline="") as file:
                writer = csv.DictWriter(file, found[0].keys(), lineterminator="\n")
                writer.writeheader()
                writer.writerows(found)


if __name__ == "__main__":
    judge(__doc__, "falling-pixels-critics.csv", rows)
