"""SAC, DrQ and CURL in PyTorch, on the networks of hksl_torch.py: what hksl's baselines are timed beside.

  python bench/baselines_torch.py bench --method drq    times one learning step on this machine
  python bench/baselines_torch.py check                 one step of each against the golden numbers of hksl's own tests

The equations are those of docs/baselines.md. Needs torch and numpy, `check` also safetensors (PyPI). Shapes: B batch,
C channels, H x W pixels, A action dims, Z latent dims.
"""

import argparse
import json
import math
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import nn

from hksl_torch import PRESETS, Actor, Config, Critic, PixelEncoder, Source, add_options, ema, placed, prepare, report, trained

GOLDEN = Path(__file__).resolve().parent.parent / "crates/hksl-baselines/tests/golden"
VIEWS = {"sac": 1, "drq": 2, "curl": 1}
DEVIATION = 1e-6  # of the largest number in a tensor: the fixtures hold f32


class Head(nn.Module):
    """The actor's own linear layer and layer norm over the convolutions of the critics' encoder."""

    def __init__(self, encoder):
        super().__init__()
        self.linear = nn.Linear(encoder.linear.in_features, encoder.linear.out_features)
        self.norm = nn.LayerNorm(encoder.linear.out_features)

    def forward(self, features):
        return self.norm(self.linear(features))


class Policy(Actor):
    def __init__(self, cfg, encoder):
        super().__init__(cfg)
        self.head = Head(encoder)

    def forward(self, features, noise):
        return super().forward(self.head(features), noise)


class Sac(nn.Module):
    """Soft actor-critic from pixels; over several views of each observation, DrQ."""

    def __init__(self, cfg, rate=1e-3, adam=torch.optim.Adam):
        super().__init__()
        self.cfg = cfg
        self.encoder, self.critic = PixelEncoder(cfg.obs, cfg.filters, cfg.latent), Critic(cfg)
        self.targets = nn.ModuleDict(
            {"encoder": PixelEncoder(cfg.obs, cfg.filters, cfg.latent), "critic": Critic(cfg)})
        self.actor = Policy(cfg, self.encoder)
        self.log_alpha = nn.Parameter(torch.tensor(math.log(0.1)))
        self.add_own()
        self.targets.encoder.load_state_dict(self.encoder.state_dict())
        self.targets.critic.load_state_dict(self.critic.state_dict())
        self.critic_opt = adam([*self.encoder.parameters(), *self.critic.parameters()], rate)
        self.actor_opt = adam(self.actor.parameters(), rate)
        self.alpha_opt = adam([self.log_alpha], rate)
        self.add_own_optimisers(rate, adam)

    def add_own(self):
        """What a method has beside these networks."""

    def add_own_optimisers(self, rate, adam):
        """And what trains it."""

    @torch.no_grad()
    def view_target(self, next_obs, noise, rewards, not_done):
        """The target (B, 1) on one view: the policy on the encoder as trained, the critics' targets on theirs."""
        action, log_prob = self.actor(self.encoder.features(next_obs), noise)
        value = torch.minimum(*self.targets.critic(self.targets.encoder(next_obs), action))
        return rewards + self.cfg.discount * not_done * (value - self.log_alpha.exp() * log_prob)

    def critic_loss(self, views, actions, target):
        loss = 0.0
        for obs in views:
            for q in self.critic(self.encoder(obs), actions):
                loss = loss + F.mse_loss(q, target)
        return loss

    def actor_loss(self, obs, noise):
        """The actor's loss and log-probabilities; no gradient reaches encoder and critics."""
        with torch.no_grad():
            features = self.encoder.features(obs)
            z = self.encoder.project(features)
        action, log_prob = self.actor(features, noise)
        return (self.log_alpha.exp().detach() * log_prob - torch.minimum(*self.critic(z, action))).mean(), log_prob

    def descend(self, loss, *optimisers):
        """One gradient, one step of each of these optimisers along it."""
        for optimiser in optimisers:
            optimiser.zero_grad(set_to_none=True)
        loss.backward()
        for optimiser in optimisers:
            optimiser.step()
        return loss.detach()

    def step(self, views, next_views, actions, rewards, not_done, target_noises, actor_noise):
        """One learning step, everything due: critics with the encoder, actor, temperature, targets."""
        targets = [self.view_target(obs, noise, rewards, not_done) for obs, noise in zip(next_views, target_noises)]
        target = torch.stack(targets).mean(0)
        losses = {"critic_loss": self.descend(self.critic_loss(views, actions, target), self.critic_opt)}
        loss, log_prob = self.actor_loss(views[0], actor_noise)
        losses["actor_loss"] = self.descend(loss, self.actor_opt)
        loss = (self.log_alpha.exp() * (self.cfg.action - log_prob.detach())).mean()
        losses["alpha_loss"] = self.descend(loss, self.alpha_opt)
        ema(self.critic, self.targets.critic, self.cfg.q_tau)
        ema(self.encoder, self.targets.encoder, self.cfg.encoder_tau)
        return losses


class Curl(Sac):
    """SAC, then the contrastive step: one gradient, two Adams, whose keys come from the targets as just moved."""

    def add_own(self):
        self.bilinear = nn.Parameter(torch.rand(self.cfg.latent, self.cfg.latent))

    def add_own_optimisers(self, rate, adam):
        self.encoder_opt = adam(self.encoder.parameters(), rate)
        self.contrastive_opt = adam([*self.encoder.parameters(), self.bilinear], rate)

    def contrastive_loss(self, queries, keys):
        with torch.no_grad():
            keys = self.targets.encoder(keys)
        logits = self.encoder(queries) @ self.bilinear @ keys.T
        return F.cross_entropy(logits, torch.arange(len(logits), device=logits.device))

    def step(self, views, *rest):
        """`views`: the queries, of which the critics learn, and the keys."""
        losses = super().step(views[:1], *rest)
        loss = self.contrastive_loss(*views)
        losses["contrastive_loss"] = self.descend(loss, self.encoder_opt, self.contrastive_opt)
        return losses


METHODS = {"sac": Sac, "drq": Sac, "curl": Curl}


class Draws(Source):
    """What a step of a method learns from, drawn anew each time."""

    def __init__(self, cfg, device, method):
        super().__init__(cfg, device)
        self.method = method

    def draw(self):
        actions, rewards, not_done = (x.to(self.device) for x in self.numbers)
        pairs = [self.shifted() for _ in range(VIEWS[self.method])]
        views, next_views = [pair[:, 0] for pair in pairs], [pair[:, 1] for pair in pairs]
        if self.method == "curl":
            views.append(self.shifted(1)[:, 0])
        noises = [self.noise() for _ in next_views]
        return views, next_views, actions[:, 0], rewards, not_done, noises, self.noise()


def bench(args):
    adam = prepare(args)
    sizes = {key: PRESETS[args.preset][key] for key in ("obs", "action")}
    cfg = Config(**sizes, skips=(1,), k=1, batch=args.batch)
    with torch.device(args.device):
        agent = METHODS[args.method](cfg, adam=adam)
    placed(args, [agent])
    parameters = trained([agent]) - trained([agent.targets]) - 1
    report(args, [agent], parameters, agent.step, Draws(cfg, args.device, args.method).draw)


def check(args):
    """Losses and weights after one step, in f64, against the fixtures."""
    from safetensors import safe_open

    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    for method, make in METHODS.items():
        with safe_open(GOLDEN / f"{method}.safetensors", "pt") as file:
            sizes = json.loads(file.metadata()["config"])
            tensors = {key: file.get_tensor(key) for key in file.keys()}
        names = ("action", "batch", "filters", "latent", "hidden")
        cfg = Config(obs=sizes["obs"], skips=(1,), k=1, **{name: sizes[name] for name in names})
        agent = make(cfg, sizes["sac_rate"])
        agent.load_state_dict({key[7:]: x.double() for key, x in tensors.items() if key.startswith("before.")})
        given = {key[6:]: x if "obs" in key or "positive" in key else x.double()
                 for key, x in tensors.items() if key.startswith("input.")}
        views = [*given["obs"], given["positive"]] if method == "curl" else list(given["obs"])
        losses = agent.step(views, list(given["next_obs"]), given["actions"], given["rewards"], given["not_done"],
                            list(given["noise.target"]), given["noise.actor"])
        # The critics' loss is the first of the step: at the weights that the fixture's values are of.
        found = {"value.critic_loss": losses["critic_loss"]}
        found |= {f"after.{name}": x for name, x in agent.state_dict().items()}
        wanted = {key for key in tensors if key.startswith("after.")}
        assert wanted == {key for key in found if key.startswith("after.")}, (method, wanted ^ set(found))
        for key, value in found.items():
            expected = tensors[key].double()
            off = (value - expected).abs().max() / expected.abs().max()
            assert off < DEVIATION, (method, key, off.item())
        print(f"{method}: {len(found)} tensors as in the golden numbers")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sub = parser.add_subparsers(required=True)
    p = sub.add_parser("bench", help="time learning steps")
    p.add_argument("--method", choices=METHODS, required=True)
    add_options(p)
    p.set_defaults(run=bench)
    sub.add_parser("check", help="compare a step of each with the golden numbers").set_defaults(run=check)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
