#!/usr/bin/env python3
"""How well can a critic know the next reward of Falling Pixels from N transitions? Supervised, in PyTorch.

Independent of hksl: the task is stated again here, the encoder is the PyTorch one of bench/hksl_torch.py, the critic's
head is the paper's. It sees three frames and an action, is trained on the reward of the next step under random actions,
and is judged on episodes it was not trained on. Nothing is bootstrapped and no policy changes, so what it cannot learn
here, no agent with this encoder learns from as many transitions.

    python3 results/learning/supervised.py --pad 4 --transitions 60000 --updates 12000

Writes supervised-pad-4-60000.csv beside itself: error of training and of held-out episodes, as shares of the variance
of the held-out rewards (1: as good as the mean). Needs torch and numpy; twelve minutes on one core.
"""

import argparse
import csv
import pathlib
import sys

import numpy as np
import torch
import torch.nn.functional as F

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent.parent / "bench"))
sys.dont_write_bytecode = True
from hksl_torch import PixelEncoder, mlp  # noqa: E402

ROWS, COLUMNS, EPISODE_STEPS, SPEEDS, SPAWN_PROBABILITY = 35, 15, 250, [1, 3, 5], 0.025
STACKED_FRAMES, BATCH, LATENT, HIDDEN = 3, 128, 50, 1024
HELD_OUT_EPISODES = 40
EMPTY = -1


def frame(agent, rows):
    picture = np.zeros((ROWS, COLUMNS), np.uint8)
    picture[ROWS - 1, agent] = 255
    falling = np.flatnonzero(rows != EMPTY)
    picture[rows[falling], falling] = 255
    return picture


def episode(rng):
    """Observations (T, 3, 35, 15), actions (T, 1) and the rewards (T, 1) that follow, under uniformly random actions."""
    agent, rows, speeds = rng.integers(COLUMNS), np.zeros(COLUMNS, int), rng.choice(SPEEDS, COLUMNS)
    frames = [frame(agent, rows)] * STACKED_FRAMES
    observations, actions, rewards = [], [], []
    for _ in range(EPISODE_STEPS):
        observations.append(np.stack(frames))
        action = rng.uniform(-1, 1)
        agent = np.clip(agent + (action > 1 / 3) - (action < -1 / 3), 0, COLUMNS - 1)
        was_empty = rows == EMPTY
        rows = np.where(was_empty, EMPTY, np.minimum(rows + speeds, ROWS - 1))
        reward = float(rows[agent] == ROWS - 1)
        rows[rows == ROWS - 1] = EMPTY
        new = was_empty & (rng.random(COLUMNS) < SPAWN_PROBABILITY)
        rows[new], speeds[new] = 0, rng.choice(SPEEDS, new.sum())
        frames = [*frames[1:], frame(agent, rows)]
        actions.append([action])
        rewards.append([reward])
    return np.stack(observations), np.float32(actions), np.float32(rewards)


def episodes(rng, count):
    return [torch.from_numpy(np.concatenate(part)) for part in zip(*(episode(rng) for _ in range(count)))]


def shift(observations, pad):
    """Each observation moved by up to `pad` pixels in both directions, its edges repeated."""
    if pad == 0:
        return observations
    padded = F.pad(observations.float(), (pad,) * 4, mode="replicate")
    tops, lefts = torch.randint(0, 2 * pad + 1, (2, len(observations), 1))
    rows, columns = tops + torch.arange(ROWS), lefts + torch.arange(COLUMNS)
    which = torch.arange(len(observations))[:, None, None]
    return padded[which, :, rows[:, :, None], columns[:, None, :]].permute(0, 3, 1, 2)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--pad", type=int, default=4, help="pixels of the random shift")
    options.add_argument("--transitions", type=int, default=60_000, help="to learn from, whole episodes of 250")
    options.add_argument("--updates", type=int, default=12_000)
    options.add_argument("--every", type=int, default=500, help="updates between two judgements")
    options.add_argument("--learning-rate", type=float, default=1e-3)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--threads", type=int, default=1)
    options = options.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    rng = np.random.default_rng(options.seed)
    observations, actions, rewards = episodes(rng, options.transitions // EPISODE_STEPS)
    held_out = episodes(rng, HELD_OUT_EPISODES)
    variance = held_out[2].var(unbiased=False).item()

    encoder = PixelEncoder((STACKED_FRAMES, ROWS, COLUMNS), 32, LATENT)
    head = mlp([LATENT + 1, HIDDEN, HIDDEN, 1])
    adam = torch.optim.Adam([*encoder.parameters(), *head.parameters()], lr=options.learning_rate)

    def predicted(observations, actions):
        return head(torch.cat([encoder(observations), actions], 1))

    target = HERE / f"supervised-pad-{options.pad}-{options.transitions}.csv"
    with open(target, "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["update", "training_error", "held_out_error"])
        losses = []
        for update in range(1, options.updates + 1):
            drawn = torch.randint(0, len(observations), (BATCH,))
            loss = F.mse_loss(predicted(shift(observations[drawn], options.pad), actions[drawn]), rewards[drawn])
            adam.zero_grad()
            loss.backward()
            adam.step()
            losses.append(loss.item())
            if update % options.every == 0:
                with torch.no_grad():
                    error = np.mean([F.mse_loss(predicted(seen, action), reward).item()
                                     for seen, action, reward in zip(*(part.split(500) for part in held_out))])
                table.writerow([update, f"{np.mean(losses) / variance:.3f}", f"{error / variance:.3f}"])
                file.flush()
                print(f"{update} updates: training {np.mean(losses) / variance:.3f}, held out {error / variance:.3f}",
                      flush=True)
                losses.clear()


if __name__ == "__main__":
    main()
