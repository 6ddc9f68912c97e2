#!/usr/bin/env python3
"""What the latents of a run on Falling Pixels carry of the pixels that are about to land near the agent.

    python3 results/learning/encoders.py RUNS/falling-pixels/hksl-orth/seed-1@10000 ... --out encoders.csv

Each argument is a run's folder and an environment step at which it kept its weights. For each of the five columns
around the agent, a network of two layers of 256 predicts from the frozen latents of all levels the discounted number of
pixels that land there within 5 steps, which does not depend on what the agent does. 160 episodes of random moves fit it,
40 others judge it. A row a checkpoint:

  explained          share of the held-out variance that the network explains, the best of 12 evaluations of 500 updates
  explained_linear   the same of a linear map
  explained_fitted   of the network, on episodes that it was fitted on, at the end

Needs torch, numpy and safetensors; 40 s a checkpoint on one core.
"""

import functools
import pathlib
import sys

import numpy as np
import torch
from torch import nn

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE))
sys.dont_write_bytecode = True
from critics import DISCOUNT, Agent, Episodes, judge  # noqa: E402
from supervised import EPISODE_STEPS, MOVES  # noqa: E402

AHEAD, NEAR, HIDDEN, BATCH, UPDATES, EVERY = 5, 2, 256, 512, 6000, 500


@functools.cache
def examples(seed, count):
    """Observations (N, 3, H, W) and what lands around the agent, (N, 2·NEAR + 1)."""
    rng = np.random.default_rng(seed)
    episodes = Episodes(count, rng)
    observations, landings, agents = [], [], []
    for _ in range(EPISODE_STEPS):
        observations.append(episodes.observations())
        agents.append(episodes.agent)
        episodes.step(rng.choice(np.float64(MOVES), count))
        landings.append(np.pad(episodes.landed, ((0, 0), (NEAR, NEAR))))
    soon = [sum(DISCOUNT**step * landings[time + step] for step in range(AHEAD)) for time in range(EPISODE_STEPS - AHEAD)]
    around = [[found[np.arange(count), agent + column] for column in range(2 * NEAR + 1)]
              for found, agent in zip(soon, agents)]
    wanted = np.float32(around).transpose(0, 2, 1).reshape(-1, 2 * NEAR + 1)
    return torch.cat(observations[:len(soon)]), torch.from_numpy(wanted)


@torch.no_grad()
def explained(model, latents, wanted):
    return 1 - (model(latents) - wanted).square().mean().item() / wanted.var(0, unbiased=False).mean().item()


def fit(model, seen, held_out):
    """The best share on held-out examples, and the last on as many that were fitted."""
    best, optimizer = -np.inf, torch.optim.Adam(model.parameters(), 1e-3)
    for update in range(1, UPDATES + 1):
        which = torch.randint(len(seen[0]), (BATCH,))
        loss = (model(seen[0][which]) - seen[1][which]).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if update % EVERY == 0:
            best = max(best, explained(model, *held_out))
    count = len(held_out[0])
    return best, explained(model, seen[0][:count], seen[1][:count])


@torch.no_grad()
def latents(agent, observations):
    return torch.cat([torch.cat(agent.encode(part)[0], 1) for part in observations.split(1000)])


def row(run, step):
    seen, held_out = examples(1, 160), examples(2, 40)
    agent = Agent(run / "checkpoints" / f"step-{step:09d}" / "weights.safetensors")
    inputs, judged = latents(agent, seen[0]), latents(agent, held_out[0])
    mean, deviation = inputs.mean(0), inputs.std(0) + 1e-6
    seen, held_out = (((x - mean) / deviation, wanted) for x, (_, wanted) in ((inputs, seen), (judged, held_out)))
    torch.manual_seed(0)
    size, outputs = inputs.shape[1], 2 * NEAR + 1
    linear, _ = fit(nn.Linear(size, outputs), seen, held_out)
    network = nn.Sequential(nn.Linear(size, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
                            nn.Linear(HIDDEN, outputs))
    best, fitted = fit(network, seen, held_out)
    return {"agent": run.parent.name, "seed": run.name.removeprefix("seed-"), "environment_step": step,
            "explained": f"{best:.3f}", "explained_linear": f"{linear:.3f}", "explained_fitted": f"{fitted:.3f}"}


if __name__ == "__main__":
    judge(__doc__, "falling-pixels-encoders.csv", lambda run, step: [row(run, step)])
