"""Golden numbers of one HKSL learning step, from the statement in hksl_torch.py.

  python bench/hksl_golden.py make     writes crates/hksl-core/tests/golden/*.safetensors, from the first seed that serves
  python bench/hksl_golden.py check    compares these files with what the statement gives for their weights and inputs

The README beside the files says what they hold. Everything is computed in f64 from weights and inputs that f32 holds
exactly. Needs: torch, numpy, safetensors (PyPI). Shapes as in hksl_torch.py.
"""

import argparse
import itertools
import json
import math
import pathlib

import torch
import torch.nn.functional as F
from safetensors import safe_open
from safetensors.torch import save_file
from torch import nn
from torch.optim.optimizer import register_optimizer_step_pre_hook
from torch.overrides import TorchFunctionMode

from hksl_torch import Config, Hksl

FOLDER = pathlib.Path(__file__).parent.parent / "crates/hksl-core/tests/golden"
RATES = {"lr": 1e-3, "hksl_lr": 1e-4}
SMALL = {"filters": 4, "latent": 6, "hidden": 16, "communication_hidden": 10}
CASES = {
    "one_level": dict(obs=(3, 20, 20), action=1, skips=(1,), k=3, batch=4, **SMALL),
    "two_levels": dict(obs=(3, 20, 22), action=2, skips=(1, 3), k=6, batch=5, **SMALL),
    "three_levels": dict(obs=(3, 35, 15), action=1, skips=(1, 3, 5), k=6, batch=4, **SMALL),
    "uneven_skips": dict(obs=(9, 24, 24), action=3, skips=(4, 5), k=10, batch=3, **SMALL),
    "full_width": dict(obs=(9, 21, 21), action=2, skips=(1, 3), k=6, batch=3, filters=32, latent=50, hidden=64),
}

KINK = 1e-6  # the least distance of a ReLU or minimum from its kink
VALUES = 3e-6  # how far f32 may be off in a value, gradient or loss, of the largest in its tensor
NOISE = 1e-6  # how far every gradient is moved to see whether a step is decided by rounding, of the largest
MOVEMENTS = 3e-4  # how far a weight's movement may then be off, of the largest movement in its tensor
# The share of a tensor whose movement may be off by more: hardly a seed is clear everywhere in these.
UNCLEAR = {"three_levels": 0.01, "full_width": 0.01}


class Unsuitable(Exception):
    """A draw that another implementation in f32 could not follow."""


def require(condition, message):
    if not condition:
        raise Unsuitable(message)


class AwayFromKinks(TorchFunctionMode):
    """Refuses a computation in which a ReLU or a minimum comes too close to its kink."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        name = getattr(func, "__name__", "")
        if name in ("relu", "minimum"):
            distance = args[0] if name == "relu" else args[0] - args[1]
            require(distance.abs().min() > KINK, f"{name} at its kink")
        return func(*args, **(kwargs or {}))


# Drawing weights and inputs, all in f32


def draw_lively(encoder, obs):
    """Draws an encoder of which every filter is active somewhere and whose latents differ between images: gradients would
    be small differences of large numbers otherwise. Through four convolutions of PyTorch's own width, biases would drown
    what differs between images."""
    while True:
        x = obs / 255
        for conv in encoder.convs:
            asleep = torch.ones(conv.out_channels, dtype=torch.bool)
            while asleep.any():
                spare = nn.Conv2d(conv.in_channels, conv.out_channels, 3)
                conv.weight.data[asleep] = math.sqrt(6) * spare.weight.data[asleep]
                conv.bias.data[asleep] = spare.bias.data[asleep]
                maps = conv(x).relu()
                asleep = maps.amax((0, 2, 3)) == 0
            x = maps
        encoder.linear.reset_parameters()
        if encoder(obs).std(0).mean() > 0.3:
            break
    nn.init.normal_(encoder.norm.weight, 1.0, 0.1)
    nn.init.normal_(encoder.norm.bias, 0.0, 0.1)


def draw(cfg, seed):
    """An agent, its batch and its noises. Momentum and target networks differ from the online ones."""
    torch.manual_seed(seed)
    agent = Hksl(cfg, **RATES)
    coarse = 255 * torch.rand(cfg.batch * (cfg.k + 1), cfg.obs[0], 5, 5)
    smooth = F.interpolate(coarse, cfg.obs[1:], mode="bilinear", align_corners=True)
    obs = smooth.round().to(torch.uint8).view(cfg.batch, cfg.k + 1, *cfg.obs)
    with torch.no_grad():
        for level, momentum in zip(agent.levels, agent.momentum):
            draw_lively(level.encoder, obs[:, 0])
            momentum.load_state_dict(level.encoder.state_dict())
        for module in (agent.momentum, agent.targets):
            for p in module.parameters():
                p.add_(0.05 * torch.randn(p.shape))
    not_done = torch.ones(cfg.batch, cfg.k)
    not_done[0, 1] = 0.0
    batch = (obs, torch.rand(cfg.batch, cfg.k, cfg.action) * 2 - 1, torch.rand(cfg.batch, cfg.k), not_done)
    return agent, batch, [torch.randn(cfg.batch, cfg.action) for _ in range(cfg.levels + 1)]


# What a file holds


def weights(agent):
    """Every weight by its name."""
    found = {f"{group}.{key}": value.detach().clone()
             for group, module in agent.all_modules().items() for key, value in module.state_dict().items()}
    return found | {"log_alpha": agent.log_alpha.detach().clone()}


def agent_of(cfg, named, dtype):
    """An agent of this type with these weights, whose optimisers have not stepped."""
    torch.set_default_dtype(dtype)
    agent = Hksl(cfg, **RATES)
    torch.set_default_dtype(torch.float32)
    for group, module in agent.all_modules().items():
        module.load_state_dict({key.removeprefix(f"{group}."): x for key, x in named.items() if key.startswith(f"{group}.")})
    agent.log_alpha.data = named["log_alpha"].to(dtype, copy=True)
    return agent


def record(cfg, named, batch, noises, dtype):
    """Values and gradients at these weights, the losses of a step, and the weights after it, by the files' names."""
    agent = agent_of(cfg, named, dtype)
    obs, *numbers = batch
    actions, rewards, not_done = (x.to(dtype) for x in numbers)
    noises = [noise.to(dtype) for noise in noises]
    out = {}

    def keep_gradients(loss, prefix, parameters):
        found = torch.autograd.grad(loss, list(parameters.values()), allow_unused=True)
        for key, gradient in zip(parameters, found):
            if gradient is not None:
                out[f"{prefix}.{key}"] = gradient

    for level in range(cfg.levels):
        out[f"value.encoding.{level}"] = agent.levels[level].encoder(obs[:, 0])
        loss, rolled = agent.level_loss(level, obs, actions)
        out[f"value.level_loss.{level}"], out[f"value.rollout.{level}"] = loss, torch.stack(rolled)
        keep_gradients(loss, f"grad.level_loss.{level}", dict(agent.levels.named_parameters()))
        loss, target = agent.critic_loss(level, obs, actions, rewards, not_done, noises[level])
        out[f"value.critic_loss.{level}"], out[f"value.critic_target.{level}"] = loss, target
        trained = nn.ModuleDict({"levels": agent.levels, "critics": agent.critics})
        keep_gradients(loss, f"grad.critic_loss.{level}", dict(trained.named_parameters()))
    loss, log_prob = agent.actor_loss(obs[:, 0], noises[-1])
    out["value.actor_loss"], out["value.log_prob"], out["value.alpha_loss"] = loss, log_prob, agent.alpha_loss(log_prob)
    keep_gradients(loss, "grad.actor_loss", dict(agent.actor.named_parameters()))
    losses = agent.step((obs, actions, rewards, not_done), noises)
    out |= {f"step.{name}": loss for name, loss in losses.items()}
    out |= {f"after.{name}": x for name, x in weights(agent).items()}
    return {name: x.detach().clone() for name, x in out.items()}


# Whether it can be followed in f32


def deviation(found, expected, scale):
    """The largest difference beside the largest magnitude of `scale`."""
    return ((found.double() - expected).abs().max() / scale.abs().max().clamp(min=1e-30)).item()


def off_movements(named, found, exact):
    """By name, which weights move otherwise than exactly by more than MOVEMENTS."""
    off = {}
    for name, before in named.items():
        after = exact[f"after.{name}"]
        off[name] = (found[f"after.{name}"].double() - after).abs() > MOVEMENTS * (after - before).abs().max()
    return off


def step_with_noise(cfg, named, batch, noises, sign):
    """The record in f64 of a step whose gradients are all off by NOISE of the largest in their tensor, but those that are
    exactly zero behind a dead ReLU; the signs are random, and `sign` turns them all."""
    generator = torch.Generator().manual_seed(0)

    def disturb(optimiser, args, kwargs):
        for p in (p for group in optimiser.param_groups for p in group["params"] if p.grad is not None):
            signs = torch.randint(0, 2, p.grad.shape, generator=generator) * 2 - 1
            p.grad += sign * NOISE * p.grad.abs().max() * signs * (p.grad != 0)

    handle = register_optimizer_step_pre_hook(disturb)
    try:
        return record(cfg, named, batch, noises, torch.float64)
    finally:
        handle.remove()


def fixture(cfg, seed, share):
    """All tensors of one file, of which this share of each may move as rounding has it."""
    agent, batch, noises = draw(cfg, seed)
    named = weights(agent)
    with AwayFromKinks():
        exact = record(cfg, named, batch, noises, torch.float64)
    for name, before in named.items():
        require(not exact[f"after.{name}"].equal(before.double()), f"{name} ends where it began")
    single = record(cfg, named, batch, noises, torch.float32)
    for name, value in ((name, x) for name, x in exact.items() if not name.startswith("after.")):
        off = deviation(single[name], value, value)
        require(off < VALUES, f"f32 is off by {off:.1e} in {name}")
    one, other = (off_movements(named, step_with_noise(cfg, named, batch, noises, sign), exact) for sign in (1, -1))
    unclear = {name: one[name] | other[name] for name in named}
    for name, mask in off_movements(named, single, exact).items():
        require(unclear[name].double().mean() <= share, f"noise moves {name}")
        require(not (mask & ~unclear[name]).any(), f"f32 moves {name}")
    names = ("obs", "actions", "rewards", "not_done")
    out = {f"input.{name}": x for name, x in zip(names, batch)}
    out |= {f"input.noise.{i}": noise for i, noise in enumerate(noises)}
    out |= {f"before.{name}": x for name, x in named.items()}
    out |= {f"unclear.{name}": mask.to(torch.uint8) for name, mask in unclear.items() if mask.any()}
    return out | {name: x.float() for name, x in exact.items()}


def make(names):
    for name in names:
        cfg, reasons = Config(**CASES[name]), {}
        for seed in itertools.count():
            try:
                tensors = fixture(cfg, seed, UNCLEAR.get(name, 0.0))
                break
            except Unsuitable as reason:
                kind = " ".join(str(reason).split()[:2])
                reasons[kind] = reasons.get(kind, 0) + 1
                if seed % 20 == 19:
                    print(f"{name}: {seed + 1} seeds: {reasons}; last: {reason}", flush=True)
        path = FOLDER / f"{name}.safetensors"
        metadata = {"config": json.dumps(cfg.as_dict() | {"seed": seed})}
        # What a critic's loss does not reach has no gradient in the file.
        tensors = {key: x.contiguous() for key, x in tensors.items() if not (key.startswith("grad.critic") and not x.any())}
        save_file(tensors, path, metadata=metadata)
        unclear = sum(int(x.sum()) for key, x in tensors.items() if key.startswith("unclear."))
        print(f"{name}: seed {seed}, {len(tensors)} tensors, {unclear} unclear, {path.stat().st_size} bytes; refused: {reasons}", flush=True)


def check_joint(cfg, named, batch, noises, tensors):
    """The joint schedule's losses, and its gradients as sums of those of the single losses, at the same weights."""
    agent = agent_of(cfg, named, torch.float64)
    batch, noises = (batch[0], *(x.double() for x in batch[1:])), [noise.double() for noise in noises]
    losses, models, critics, _ = agent.joint_gradients(batch, noises)
    for key, value in losses.items():
        assert deviation(value, tensors[f"value.{key}"], tensors[f"value.{key}"]) < 1e-6, key
    for kind, module, found in (("level", agent.levels, models), ("critic", nn.ModuleDict(
            {"levels": agent.levels, "critics": agent.critics}), critics)):
        for key, parameter in module.named_parameters():
            parts = [tensors.get(f"grad.{kind}_loss.{level}.{key}") for level in range(cfg.levels)]
            parts = [part.double() for part in parts if part is not None]
            assert bool(parts) == (parameter in found), (kind, key)
            if parts:
                assert deviation(found[parameter], sum(parts), max(parts, key=lambda x: x.abs().max())) < 1e-6, (kind, key)


def check(names):
    for name in names:
        with safe_open(FOLDER / f"{name}.safetensors", "pt") as file:
            sizes = json.loads(file.metadata()["config"])
            tensors = {key: file.get_tensor(key) for key in file.keys()}
        cfg, named = Config(**CASES[name]), {key[7:]: x for key, x in tensors.items() if key.startswith("before.")}
        assert {**cfg.as_dict(), "seed": sizes["seed"]} == sizes, name
        batch = [tensors[f"input.{key}"] for key in ("obs", "actions", "rewards", "not_done")]
        noises = [tensors[f"input.noise.{i}"] for i in range(cfg.levels + 1)]
        exact = {key: x for key, x in record(cfg, named, batch, noises, torch.float64).items()
                 if not (key.startswith("grad.critic") and not x.any())}
        assert set(exact) == {key for key in tensors if not key.startswith(("input.", "before.", "unclear."))}, name
        for key, value in exact.items():
            assert tensors[key].isfinite().all() and deviation(tensors[key], value, value) < 1e-7, (name, key)
        check_joint(cfg, named, batch, noises, tensors)
        print(f"{name}: {len(tensors)} tensors as the statement gives them, the joint schedule's gradients among them")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("make", "check"))
    parser.add_argument("names", nargs="*", default=list(CASES), help="the files, all if none is named")
    args = parser.parse_args()
    torch.set_num_threads(1)
    {"make": make, "check": check}[args.command](args.names)


if __name__ == "__main__":
    main()
