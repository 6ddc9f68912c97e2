#!/usr/bin/env python3
"""What can a critic know of the next reward of Falling Pixels, by the reading of what the paper leaves open?

Supervised, in PyTorch, independent of hksl: the task is stated again here, encoder, critics and forward models are those
of bench/hksl_torch.py. A critic sees three frames and an action and is trained on the reward of the next step under
uniformly random actions; nothing is bootstrapped and no policy changes. With --models RATE the encoder also takes the
steps that HKSL's own losses (one level, n = 1, k = 6) give it, at this learning rate.

    python3 results/learning/supervised.py canvas --border 4
    python3 results/learning/supervised.py canvas-models --border 4 --models 1e-3

Writes supervised/NAME.csv beside itself, a row every --every updates, judged on 20 episodes that were not trained on,
without shift:

  training_error, held_out_error   mean squared error, as a share of the variance of the held-out rewards (the mean: 1;
                                   all that can be known without the action: 0.58)
  action_spread        root of the mean variance of the predictions over the three moves (the truth: 0.106)
  action_correlation   of those predictions with the rewards that the moves would bring, each less its state's mean
  latent_rank          effective rank of the latents
  agent_error, pixel_error   error of a linear map from the latents to the agent's column and to the pixels' rows,
                             fitted on half of the held-out states, as a share of the variance
  model_loss           HKSL's loss over its six steps

Needs torch and numpy; on one core about 20 ms an update, 130 ms with --models.
"""

import argparse
import csv
import pathlib
import sys

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent.parent / "bench"))
sys.dont_write_bytecode = True
from hksl_torch import Config, Hksl  # noqa: E402

ROWS, COLUMNS, EPISODE_STEPS, SPEEDS, SPAWN_PROBABILITY = 35, 15, 250, [1, 3, 5], 0.025
STACKED_FRAMES, BATCH, TRAJECTORY, HELD_OUT_EPISODES = 3, 128, 6, 20
MOVES, EMPTY = (-1, 0, 1), -1


def episode(rng, platform):
    """One episode of random play: frames, actions, rewards, the reward of each move, the agent's column, pixels' rows.
    The agent is a platform of `platform` columns, centred on its column and cut at the walls."""
    agent, rows, speeds = rng.integers(COLUMNS), np.zeros(COLUMNS, int), rng.choice(SPEEDS, COLUMNS)
    columns = np.arange(COLUMNS)
    frames, actions, rewards, by_move, agents, pixels = [], [], [], [], [], []

    def record():
        frame = np.zeros((ROWS, COLUMNS), np.uint8)
        frame[ROWS - 1, abs(columns - agent) <= platform // 2] = 255
        falling = np.flatnonzero(rows != EMPTY)
        frame[rows[falling], falling] = 255
        frames.append(frame), agents.append(agent), pixels.append(rows.copy())

    record()
    for _ in range(EPISODE_STEPS):
        action = rng.uniform(-1, 1)
        empty = rows == EMPTY
        rows = np.where(empty, EMPTY, np.minimum(rows + speeds, ROWS - 1))
        landed = rows == ROWS - 1
        moved = [int(np.clip(agent + move, 0, COLUMNS - 1)) for move in MOVES]
        by_move.append([float(landed[abs(columns - column) <= platform // 2].sum()) for column in moved])
        move = 1 + int(action > 1 / 3) - int(action < -1 / 3)
        agent, reward = moved[move], by_move[-1][move]
        rows[landed] = EMPTY
        new = empty & (rng.random(COLUMNS) < SPAWN_PROBABILITY)
        rows[new], speeds[new] = 0, rng.choice(SPEEDS, new.sum())
        actions.append([action]), rewards.append(reward)
        record()
    return (np.stack(frames), np.float32(actions), np.float32(rewards), np.float32(by_move), np.array(agents),
            np.stack(pixels))


def episodes(rng, count, platform):
    return [np.stack(part) for part in zip(*(episode(rng, platform) for _ in range(count)))]


def stacked(frames, which, times):
    return np.stack([frames[which, np.maximum(times - age, 0)] for age in reversed(range(STACKED_FRAMES))], 1)


def shifted(observations, offsets, pad, border):
    """Each observation (N, 3, 35, 15) moved by its offsets in 0 … 2·pad, `pad` standing still, inside a black border."""
    canvas = np.pad(observations, ((0, 0), (0, 0), (border, border), (border, border)))
    padded = np.pad(canvas, ((0, 0), (0, 0), (pad, pad), (pad, pad)), "edge")
    height, width = canvas.shape[2:]
    return np.stack([image[:, y:y + height, x:x + width] for image, (y, x) in zip(padded, offsets)])


def orthogonal(module):
    if isinstance(module, (nn.Linear, nn.Conv2d)):
        nn.init.orthogonal_(module.weight, nn.init.calculate_gain("relu") if isinstance(module, nn.Conv2d) else 1.0)
        nn.init.zeros_(module.bias)


def linear_error(latents, wanted):
    """Held-out error of the best linear map, as a share of the variance: half of the states fit it, half judge it."""
    inputs = torch.cat([latents, torch.ones(len(latents), 1)], 1).double()
    wanted, half = torch.as_tensor(wanted, dtype=torch.float64), len(inputs) // 2
    fit = torch.linalg.lstsq(inputs[:half], wanted[:half]).solution
    error = (inputs[half:] @ fit - wanted[half:]).square().mean(0)
    return (error.mean() / wanted[half:].var(0, unbiased=False).mean()).item()


class Study:
    def __init__(self, options):
        self.options, self.rng = options, np.random.default_rng(options.seed)
        torch.manual_seed(options.seed)
        self.seen = episodes(self.rng, options.transitions // EPISODE_STEPS, options.platform)
        self.held_out = episodes(self.rng, HELD_OUT_EPISODES, options.platform)
        height, width = ROWS + 2 * options.border, COLUMNS + 2 * options.border
        config = Config(obs=(STACKED_FRAMES, height, width), skips=(1,), k=TRAJECTORY, batch=BATCH,
                        filters=options.filters, hidden=options.hidden)
        self.agent = Hksl(config, lr=options.learning_rate, hksl_lr=options.models or options.learning_rate)
        self.encoder, self.critic = self.agent.levels[0].encoder, self.agent.critics[0]
        if options.orthogonal:
            self.encoder.apply(orthogonal), self.critic.apply(orthogonal)
            self.agent.momentum[0].load_state_dict(self.encoder.state_dict())

    def batch(self):
        """Observations (B, T, 3, H, W), actions (B, T, 1) and rewards (B, 1); T = 1, or 7 with models."""
        frames, actions, rewards, *_ = self.seen
        steps = TRAJECTORY if self.options.models else 0
        which = self.rng.integers(len(frames), size=BATCH)
        times = self.rng.integers(EPISODE_STEPS - steps, size=BATCH)
        observations = np.stack([stacked(frames, which, times + step) for step in range(steps + 1)], 1)
        shape = (BATCH, 1 if self.options.shift_per == "trajectory" else steps + 1, 2)
        offsets = np.broadcast_to(self.rng.integers(2 * self.options.pad + 1, size=shape), (BATCH, steps + 1, 2))
        flat = shifted(observations.reshape(-1, STACKED_FRAMES, ROWS, COLUMNS), offsets.reshape(-1, 2),
                       self.options.pad, self.options.border)
        observations = torch.from_numpy(flat).view(BATCH, steps + 1, *flat.shape[1:])
        taken = np.stack([actions[which, times + step] for step in range(max(steps, 1))], 1)
        return observations, torch.from_numpy(taken), torch.from_numpy(rewards[which, times])[:, None]

    def update(self):
        """One step of the models, if there are any, and one of the critic; their losses."""
        observations, actions, rewards = self.batch()
        losses = {}
        if self.options.models:
            loss, _ = self.agent.level_loss(0, observations, actions)
            losses["model_loss"] = descend(loss, self.agent.level_opts[0])
        q1, q2 = self.critic(self.encoder(observations[:, 0]), actions[:, 0])
        loss = F.mse_loss(q1, rewards) + F.mse_loss(q2, rewards)
        losses["training_error"] = descend(loss, self.agent.critic_opts[0]) / 2
        return losses

    @torch.no_grad()
    def judge(self):
        frames, actions, rewards, by_move, agents, pixels = self.held_out
        which, times = (part.ravel() for part in np.indices(rewards.shape))
        count, offsets = len(which), np.full((len(which), 2), self.options.pad)
        seen = shifted(stacked(frames, which, times), offsets, self.options.pad, self.options.border)
        latents = torch.cat([self.encoder(part) for part in torch.from_numpy(seen).split(512)])
        predicted = lambda taken: sum(self.critic(latents, taken))[:, 0] / 2
        rewards = torch.from_numpy(rewards[which, times])
        variance = rewards.var(unbiased=False).item()
        of_moves = torch.stack([predicted(torch.full((count, 1), float(move))) for move in MOVES], 1)
        of_moves = of_moves - of_moves.mean(1, keepdim=True)
        true = torch.from_numpy(by_move[which, times])
        true = true - true.mean(1, keepdim=True)
        centred = latents - latents.mean(0)
        covariance = centred.T @ centred
        return variance, {
            "held_out_error": F.mse_loss(predicted(torch.from_numpy(actions[which, times])), rewards).item() / variance,
            "action_spread": of_moves.square().mean().sqrt().item(),
            "action_correlation": F.cosine_similarity(of_moves.flatten(), true.flatten(), dim=0).item(),
            "latent_rank": (covariance.trace().square() / covariance.square().sum()).item(),
            "agent_error": linear_error(latents, agents[which, times][:, None]),
            "pixel_error": linear_error(latents, pixels[which, times]),
        }


def descend(loss, optimiser):
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()
    return loss.item()


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("name", help="of the CSV file")
    options.add_argument("--pad", type=int, default=4, help="pixels of the random shift")
    options.add_argument("--border", type=int, default=0, help="black pixels around a frame; pad or more: nothing is cut")
    options.add_argument("--shift-per", choices=["observation", "trajectory"], default="observation")
    options.add_argument("--platform", type=int, default=1, help="columns of the agent, an odd number")
    options.add_argument("--orthogonal", action="store_true", help="orthogonal weights in place of uniform ones")
    options.add_argument("--models", type=float, default=0.0, metavar="RATE", help="learning rate of HKSL's models; 0: none")
    options.add_argument("--transitions", type=int, default=60_000, help="to learn from, whole episodes of 250")
    options.add_argument("--updates", type=int, default=2_500)
    options.add_argument("--every", type=int, default=500, help="updates between two rows")
    options.add_argument("--filters", type=int, default=16)
    options.add_argument("--hidden", type=int, default=256)
    options.add_argument("--learning-rate", type=float, default=1e-3, help="of the critic and the encoder under it")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--threads", type=int, default=1)
    options = options.parse_args()
    torch.set_num_threads(options.threads)
    study, rows, losses = Study(options), [], []
    target = HERE / "supervised" / f"{options.name}.csv"
    target.parent.mkdir(exist_ok=True)
    for update in range(1, options.updates + 1):
        losses.append(study.update())
        if update % 2 == 0:
            study.agent.ema()
        if update % options.every:
            continue
        variance, row = study.judge()
        mean = {name: np.mean([loss[name] for loss in losses]) for name in losses[0]}
        mean["training_error"] /= variance
        row = {"update": update, **{name: f"{number:.3f}" for name, number in (mean | row).items()}}
        rows.append(row), losses.clear()
        with open(target, "w", newline="") as file:
            table = csv.DictWriter(file, row, lineterminator="\n")
            table.writeheader()
            table.writerows(rows)
        print(", ".join(f"{name} {number}" for name, number in row.items()), flush=True)


if __name__ == "__main__":
    main()
