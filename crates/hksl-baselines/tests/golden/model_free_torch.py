"""Independent PyTorch statements of SAC, DrQ, CURL, PI-SAC and DBC, written from their equations.

  python model_free_torch.py make    writes the fixtures beside this file: weights, inputs, values, gradients and the
                                     weights after one whole update, so that another implementation can be checked
                                     number by number;
  python model_free_torch.py check   compares the loss functions with numbers computed elsewhere, the gradients with
                                     finite differences, and the fixtures with what the statements give today.

Needs torch, numpy and safetensors (PyPI). Shapes: V views, B batch, C channels, H x W pixels, A action dims, Z latent
dims, E ensemble members. Everything is computed in f64 from weights and inputs that f32 holds exactly.
"""

import argparse
import copy
import dataclasses
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

HERE = pathlib.Path(__file__).parent


@dataclasses.dataclass
class Config:
    """What a fixture's metadata key `config` holds."""

    method: str
    model: str | None = None
    seed: int | None = None
    views: int = 1
    batch: int = 5
    obs: tuple = (3, 19, 17)
    action: int = 2
    filters: int = 4
    latent: int = 6
    hidden: int = 16
    head_hidden: int = 12
    model_hidden: int = 12
    members: int = 1
    discount: float = 0.99
    q_tau: float = 0.01
    encoder_tau: float = 0.05
    backward_tau: float = 0.05
    log_std_min: float = -10.0
    log_std_max: float = 2.0
    sac_rate: float = 1e-3
    ceb_rate: float = 3e-4
    ceb_beta: float = 0.01
    ceb_smoothing: float = 0.6
    bisimulation_weight: float = 0.5
    decoder_decay: float = 1e-7
    sigma_min: float = 1e-4
    sigma_max: float = 10.0

    def as_json(self):
        return json.dumps({key: value for key, value in vars(self).items() if value is not None})


CASES = {
    "sac": Config("sac"),
    "drq": Config("drq", views=2),
    "curl": Config("curl", batch=6),
    "pi-sac": Config("pi-sac"),
    "dbc": Config("dbc", model="probabilistic"),
    "dbc-ensemble": Config("dbc", model="ensemble", members=5),
}


# Equations


def bounded_log_std(raw, low, high):
    """Squashes the actor's raw output into [low, high]."""
    return low + 0.5 * (high - low) * (torch.tanh(raw) + 1)


def log_jacobian(pre_tanh):
    """ln(1 - tanh(u)^2), exact for every u."""
    return 2 * (math.log(2) - pre_tanh - F.softplus(-2 * pre_tanh))


def tanh_gaussian(mean, log_std, noise):
    """The action tanh(mean + std * noise) (B, A) and its log-density (B, 1)."""
    pre_tanh = mean + log_std.exp() * noise
    log_prob = -0.5 * noise**2 - log_std - 0.5 * math.log(2 * math.pi) - log_jacobian(pre_tanh)
    return torch.tanh(pre_tanh), log_prob.sum(-1, keepdim=True)


def contrastive_loss(queries, keys, bilinear):
    """CURL: cross-entropy of q_i W k_j, the positive of row i being column i."""
    logits = queries @ bilinear @ keys.T
    return F.cross_entropy(logits, torch.arange(len(logits)))


def log_unit_normal(z, mean):
    """Log-density of N(mean, I) at z, over the last dimension."""
    return -0.5 * ((z - mean) ** 2 + math.log(2 * math.pi)).sum(-1)


def ceb_terms(forward, noise, backward0, backward1):
    """PI-SAC: i_xz, i_yz and i_xz1, each (B, 1), of one sample z = forward + noise for each item."""
    z = forward + noise
    log_e, log_b1 = log_unit_normal(z, forward), log_unit_normal(z, backward1)
    log_b_all = log_unit_normal(z[:, None], backward0[None])
    log_b0 = log_b_all.diagonal()
    i_yz = log_b0 - log_b_all.logsumexp(1) + math.log(len(z))
    return (log_e - log_b0)[:, None], i_yz[:, None], (log_e - log_b1)[:, None]


def ceb_loss(i_xz, i_yz, i_xz1, beta, smoothing):
    """PI-SAC: the conditional entropy bottleneck with its first smoothing term."""
    return (beta * i_xz - i_yz + smoothing * beta * i_xz1).mean()


def transition_loss(mean, sigma, next_latent):
    """DBC: Gaussian negative log-likelihood without its constant; mean over members, batch and dimensions."""
    return (0.5 * ((mean - next_latent.detach()) / sigma) ** 2 + sigma.log()).mean()


def bisimulation_loss(latent, rewards, mean, sigma, permutation, discount):
    """DBC: latent distances against reward distances plus discounted per-dimension Wasserstein distances."""
    latent_distance = F.smooth_l1_loss(latent, latent[permutation], reduction="none")
    reward_distance = F.smooth_l1_loss(rewards, rewards[permutation], reduction="none")
    mean, sigma = mean.detach(), sigma.detach()
    mean_gap, sigma_gap = mean - mean[..., permutation, :], sigma - sigma[..., permutation, :]
    transition_distance = (mean_gap**2 + sigma_gap**2).sqrt()
    return ((latent_distance - (reward_distance + discount * transition_distance)) ** 2).mean()


# Networks


def mlp(*sizes):
    """Linear layers numbered 0, 2, 4, ... with a ReLU after each but the last."""
    layers = []
    for before, after in itertools.pairwise(sizes):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class Projection(nn.Module):
    """Flattened feature maps -> (B, Z): a linear layer and a layer norm, no tanh."""

    def __init__(self, cfg):
        super().__init__()
        _, height, width = cfg.obs
        maps = cfg.filters * ((height - 3) // 2 - 5) * ((width - 3) // 2 - 5)
        self.linear = nn.Linear(maps, cfg.latent)
        self.norm = nn.LayerNorm(cfg.latent)

    def forward(self, features):
        return self.norm(self.linear(features))


class Encoder(Projection):
    """(B, C, H, W) in 0..255 -> (B, Z): four 3x3 convolutions with strides 2, 1, 1, 1, then the projection."""

    def __init__(self, cfg):
        super().__init__(cfg)
        channels = [cfg.obs[0]] + 4 * [cfg.filters]
        self.convs = nn.ModuleList(nn.Conv2d(channels[i], channels[i + 1], 3, 1 if i else 2) for i in range(4))

    def maps(self, obs):
        """The feature maps of every convolution."""
        maps = [obs.to(self.linear.weight.dtype) / 255]
        for conv in self.convs:
            maps.append(torch.relu(conv(maps[-1])))
        return maps[1:]

    def features(self, obs):
        return self.maps(obs)[-1].flatten(1)

    def forward(self, obs):
        return super().forward(self.features(obs))


class Critic(nn.Module):
    """Twin action values (B, 1) of latents and actions."""

    def __init__(self, cfg):
        super().__init__()
        self.q1 = mlp(cfg.latent + cfg.action, cfg.hidden, cfg.hidden, 1)
        self.q2 = mlp(cfg.latent + cfg.action, cfg.hidden, cfg.hidden, 1)

    def forward(self, z, action):
        za = torch.cat([z, action], -1)
        return self.q1(za), self.q2(za)


class Actor(nn.Module):
    """A tanh-Gaussian policy; `head` turns its input into a latent."""

    def __init__(self, cfg, head):
        super().__init__()
        self.bounds = (cfg.log_std_min, cfg.log_std_max)
        self.head = head
        self.trunk = mlp(cfg.latent, cfg.hidden, cfg.hidden, 2 * cfg.action)

    def forward(self, x, noise):
        mean, raw = self.trunk(self.head(x)).chunk(2, -1)
        return tanh_gaussian(mean, bounded_log_std(raw, *self.bounds), noise)


class CebHead(nn.Sequential):
    """PI-SAC: an MLP and a batch norm on batch statistics; the first Z of the 2Z outputs are the mean."""

    def __init__(self, inputs, cfg):
        super().__init__(*mlp(inputs, cfg.head_hidden, cfg.head_hidden, 2 * cfg.latent))
        self.add_module("norm", nn.BatchNorm1d(2 * cfg.latent, eps=1e-3, track_running_stats=False))

    def forward(self, x):
        return super().forward(x).chunk(2, -1)[0]


class Transition(nn.Module):
    """DBC: the next latent's mean and standard deviation, each (B, Z)."""

    def __init__(self, cfg):
        super().__init__()
        self.hidden = nn.Linear(cfg.latent + cfg.action, cfg.model_hidden)
        self.norm = nn.LayerNorm(cfg.model_hidden)
        self.mean = nn.Linear(cfg.model_hidden, cfg.latent)
        self.scale = nn.Linear(cfg.model_hidden, cfg.latent)
        self.low, self.high = cfg.sigma_min, cfg.sigma_max

    def forward(self, z, action):
        x = torch.relu(self.norm(self.hidden(torch.cat([z, action], -1))))
        return self.mean(x), self.low + (self.high - self.low) * torch.sigmoid(self.scale(x))


class Ensemble(nn.ModuleList):
    """DBC: several transition models; each output is (E, B, Z)."""

    def __init__(self, cfg):
        super().__init__(Transition(cfg) for _ in range(cfg.members))

    def forward(self, z, action):
        means, sigmas = zip(*(member(z, action) for member in self))
        return torch.stack(means), torch.stack(sigmas)


class Reward(nn.Module):
    """DBC: the reward (B, 1) obtained on the way to a predicted latent."""

    def __init__(self, cfg):
        super().__init__()
        self.hidden = nn.Linear(cfg.latent, cfg.model_hidden)
        self.norm = nn.LayerNorm(cfg.model_hidden)
        self.output = nn.Linear(cfg.model_hidden, 1)

    def forward(self, z):
        return self.output(torch.relu(self.norm(self.hidden(z))))


# Methods


class Sac(nn.Module):
    """SAC from pixels. The actor has a projection of its own on the critic encoder's convolutions."""

    trained_by = {"critic": ("encoder", "critic"), "actor": ("actor",), "temperature": ("log_alpha",)}

    def __init__(self, cfg):
        super().__init__()
        self.cfg = cfg
        self.encoder, self.critic = Encoder(cfg), Critic(cfg)
        self.targets = nn.ModuleDict({"encoder": Encoder(cfg), "critic": Critic(cfg)})
        self.actor = Actor(cfg, self.actor_head())
        self.log_alpha = nn.Parameter(torch.tensor(math.log(0.1)))

    def actor_head(self):
        return Projection(self.cfg)

    def policy(self, obs, noise):
        """Action and log-probability; no gradient reaches the convolutions."""
        return self.actor(self.encoder.features(obs).detach(), noise)

    def view_target(self, next_obs, noise, batch):
        """One view's target: the policy acts on the online encoder, the target critic on the target encoder."""
        action, log_prob = self.policy(next_obs, noise)
        value = torch.minimum(*self.targets.critic(self.targets.encoder(next_obs), action))
        value = value - self.log_alpha.exp() * log_prob
        return batch["rewards"] + self.cfg.discount * batch["not_done"] * value

    def critic_target(self, batch):
        """The target (B, 1), averaged over views, each with an action of its own."""
        views = zip(batch["next_obs"], batch["noise.target"])
        return torch.stack([self.view_target(*view, batch) for view in views]).mean(0).detach()

    def critic_loss(self, batch, target):
        """Squared errors of both critics, summed over views."""
        loss = 0.0
        for obs in batch["obs"]:
            q1, q2 = self.critic(self.encoder(obs), batch["actions"])
            loss = loss + F.mse_loss(q1, target) + F.mse_loss(q2, target)
        return loss

    def actor_loss(self, batch):
        """The actor's loss on the first view, and the log-probability (B, 1) in it."""
        obs = batch["obs"][0]
        action, log_prob = self.policy(obs, batch["noise.actor"])
        value = torch.minimum(*self.critic(self.encoder(obs).detach(), action))
        return (self.log_alpha.exp().detach() * log_prob - value).mean(), log_prob

    def temperature_loss(self, log_prob):
        """Moves the entropy towards its target, -A."""
        return (self.log_alpha.exp() * (-log_prob.detach() + self.cfg.action)).mean()

    def losses(self, batch):
        """Every loss at the present weights by the name of what it trains, and the other values on the way."""
        target = self.critic_target(batch)
        actor_loss, log_prob = self.actor_loss(batch)
        losses = {"critic": self.critic_loss(batch, target), "actor": actor_loss,
                  "temperature": self.temperature_loss(log_prob)}
        return losses, {"critic_target": target, "log_prob": log_prob}

    def trainable(self, *groups):
        """Names and parameters of the named networks."""
        return {name: p for name, p in self.named_parameters() if name.split(".")[0] in groups}

    def adam(self, rate, *groups, decay=0.0):
        """A fresh Adam over the named networks; `decay` is added to the gradient as an L2 penalty's."""
        return torch.optim.Adam(self.trainable(*groups).values(), rate, eps=1e-8, weight_decay=decay)

    def descend(self, loss, *optimisers):
        """One backward pass, then one step of each optimiser on the same gradient."""
        self.zero_grad(set_to_none=True)
        loss.backward()
        for optimiser in optimisers:
            optimiser.step()

    def step_critic(self, batch):
        loss = self.critic_loss(batch, self.critic_target(batch))
        self.descend(loss, self.adam(self.cfg.sac_rate, "encoder", "critic"))

    def step_actor_and_temperature(self, batch):
        """The temperature uses the log-probability from before the actor's step."""
        loss, log_prob = self.actor_loss(batch)
        self.descend(loss, self.adam(self.cfg.sac_rate, "actor"))
        self.descend(self.temperature_loss(log_prob), self.adam(self.cfg.sac_rate, "log_alpha"))

    def average(self, source, target, tau):
        """target <- tau * source + (1 - tau) * target."""
        with torch.no_grad():
            for new, old in zip(source.parameters(), target.parameters(), strict=True):
                old.lerp_(new, tau)

    def average_targets(self):
        self.average(self.critic, self.targets.critic, self.cfg.q_tau)
        self.average(self.encoder, self.targets.encoder, self.cfg.encoder_tau)

    def update(self, batch):
        """One whole update, everything due. DrQ is this one with two views."""
        self.step_critic(batch)
        self.step_actor_and_temperature(batch)
        self.average_targets()


class Curl(Sac):
    """CURL: anchors against keys of the target encoder; two Adams step the encoder on the contrastive gradient."""

    trained_by = Sac.trained_by | {"contrastive": ("encoder", "bilinear")}

    def __init__(self, cfg):
        super().__init__(cfg)
        self.bilinear = nn.Parameter(torch.zeros(cfg.latent, cfg.latent))

    def contrastive_loss(self, batch):
        keys = self.targets.encoder(batch["positive"]).detach()
        return contrastive_loss(self.encoder(batch["obs"][0]), keys, self.bilinear)

    def losses(self, batch):
        losses, values = super().losses(batch)
        return losses | {"contrastive": self.contrastive_loss(batch)}, values

    def update(self, batch):
        """Keys come from the target encoder as just averaged."""
        super().update(batch)
        rate = self.cfg.sac_rate
        self.descend(self.contrastive_loss(batch), self.adam(rate, "encoder"), self.adam(rate, "encoder", "bilinear"))


class PiSac(Sac):
    """PI-SAC: a conditional entropy bottleneck between a forward and a backward encoder; no actor head."""

    trained_by = Sac.trained_by | {"ceb": ("encoder", "forward_head", "backward_head")}

    def __init__(self, cfg):
        super().__init__(cfg)
        self.targets["backward_encoder"] = Encoder(cfg)
        self.forward_head = CebHead(cfg.latent + 3 * cfg.action, cfg)
        self.backward_head = CebHead(cfg.latent + 3, cfg)

    def actor_head(self):
        return nn.Identity()

    def policy(self, obs, noise):
        """Action and log-probability; no gradient reaches the encoder."""
        return self.actor(self.encoder(obs).detach(), noise)

    def head_inputs(self, batch):
        """Input of the forward head, and the backward head's for the first and the second future."""
        rewards = batch["window_rewards"]
        backward = self.targets.backward_encoder
        return (torch.cat([self.encoder(batch["obs"][0]), batch["window_actions"].flatten(1)], -1),
                torch.cat([backward(batch["y0"]).detach(), rewards[:, 0:3]], -1),
                torch.cat([backward(batch["y1"]).detach(), rewards[:, 1:4]], -1))

    def ceb_terms(self, batch):
        x, y0, y1 = self.head_inputs(batch)
        return ceb_terms(self.forward_head(x), batch["noise.ceb"], self.backward_head(y0), self.backward_head(y1))

    def ceb_loss(self, batch):
        return ceb_loss(*self.ceb_terms(batch), self.cfg.ceb_beta, self.cfg.ceb_smoothing)

    def losses(self, batch):
        losses, values = super().losses(batch)
        terms = zip(("i_xz", "i_yz", "i_xz1"), self.ceb_terms(batch))
        return losses | {"ceb": self.ceb_loss(batch)}, values | dict(terms)

    def update(self, batch):
        super().update(batch)
        self.descend(self.ceb_loss(batch), self.adam(self.cfg.ceb_rate, *self.trained_by["ceb"]))
        self.average(self.encoder, self.targets.backward_encoder, self.cfg.backward_tau)


class Dbc(Sac):
    """DBC: latent distances that match a bisimulation metric, with learned dynamics and rewards."""

    trained_by = Sac.trained_by | {"model": ("encoder", "transition", "reward")}

    def __init__(self, cfg):
        super().__init__(cfg)
        self.transition = Ensemble(cfg) if cfg.model == "ensemble" else Transition(cfg)
        self.reward = Reward(cfg)

    def model_losses(self, batch):
        """Transition, reward and bisimulation loss; an ensemble's reward sample comes from one member."""
        latent, rewards = self.encoder(batch["obs"][0]), batch["rewards"]
        mean, sigma = self.transition(latent, batch["actions"])
        sample = mean + sigma * batch["noise.transition"]
        if "member" in batch:
            sample = sample[batch["member"].item()]
        return (transition_loss(mean, sigma, self.encoder(batch["next_obs"][0])),
                F.mse_loss(self.reward(sample), rewards),
                bisimulation_loss(latent, rewards, mean, sigma, batch["permutation"], self.cfg.discount))

    def model_loss(self, transition, reward, bisimulation):
        return self.cfg.bisimulation_weight * bisimulation + transition + reward

    def losses(self, batch):
        losses, values = super().losses(batch)
        parts = self.model_losses(batch)
        named = dict(zip(("transition_loss", "reward_loss", "bisimulation_loss"), parts))
        return losses | {"model": self.model_loss(*parts)}, values | named

    def update(self, batch):
        self.step_critic(batch)
        encoder = self.adam(self.cfg.sac_rate, "encoder")
        decoder = self.adam(self.cfg.sac_rate, "transition", "reward", decay=self.cfg.decoder_decay)
        self.descend(self.model_loss(*self.model_losses(batch)), encoder, decoder)
        self.step_actor_and_temperature(batch)
        self.average_targets()


METHODS = {"sac": Sac, "drq": Sac, "curl": Curl, "pi-sac": PiSac, "dbc": Dbc}


# Drawing weights and inputs, all in f32


def draw_linear(module, gain=1.0):
    """Uniform within 1 / sqrt(fan-in), biases included; `gain` widens the weights only."""
    bound = 1 / math.sqrt(module.weight[0].numel())
    nn.init.uniform_(module.weight, -gain * bound, gain * bound)
    nn.init.uniform_(module.bias, -bound, bound)


def draw_weights(network):
    """Random weights everywhere.

    Convolutions are wider than the rest: through four of them, biases would drown what differs between images.
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            draw_linear(module, gain=math.sqrt(6))
        elif isinstance(module, nn.Linear):
            draw_linear(module)
        elif isinstance(module, (nn.LayerNorm, nn.BatchNorm1d)):
            nn.init.normal_(module.weight, 1.0, 0.1)
            nn.init.normal_(module.bias, 0.0, 0.1)


def redraw_until_lively(encoder, obs):
    """Redraws an encoder until every filter is active somewhere and images are told apart.

    With latents nearly alike, gradients would be small differences of large numbers.
    """
    def lively():
        return all(x.amax((0, 2, 3)).min() > 0 for x in encoder.maps(obs)) and encoder(obs).std(0).mean() > 0.3

    while not lively():
        draw_weights(encoder)


def draw_images(cfg, *leading):
    """Smooth random images (..., C, H, W) u8."""
    channels, height, width = cfg.obs
    coarse = 255 * torch.rand(math.prod(leading), channels, 5, 5)
    smooth = F.interpolate(coarse, (height, width), mode="bilinear", align_corners=True)
    return smooth.round().to(torch.uint8).view(*leading, *cfg.obs)


def draw_batch(cfg):
    """The inputs of one update by name; item 1 is terminal, and the permutation leaves item 1 in place."""
    views, batch, action = cfg.views, cfg.batch, cfg.action
    inputs = {
        "obs": draw_images(cfg, views, batch),
        "next_obs": draw_images(cfg, views, batch),
        "actions": 2 * torch.rand(batch, action) - 1,
        "rewards": torch.rand(batch, 1),
        "not_done": torch.ones(batch, 1).index_fill(0, torch.tensor(1), 0.0),
        "noise.target": torch.randn(views, batch, action),
        "noise.actor": torch.randn(batch, action),
    }
    if cfg.method == "curl":
        inputs["positive"] = draw_images(cfg, batch)
    if cfg.method == "pi-sac":
        inputs["y0"], inputs["y1"] = draw_images(cfg, 2, batch).unbind()
        later_actions, later_rewards = 2 * torch.rand(batch, 2, action) - 1, torch.rand(batch, 3)
        inputs["window_actions"] = torch.cat([inputs["actions"][:, None], later_actions], 1)
        inputs["window_rewards"] = torch.cat([inputs["rewards"], later_rewards], 1)
        inputs["noise.ceb"] = torch.randn(batch, cfg.latent)
    if cfg.method == "dbc":
        inputs["permutation"] = torch.tensor([2, 1, 4, 0, 3])
        inputs["noise.transition"] = torch.randn(batch, cfg.latent)
    if cfg.model == "ensemble":
        inputs["member"] = torch.tensor([3])
    return inputs


def redraw_always_active(head, inputs):
    """Redraws units of the last hidden layer until each is active for a part only of every batch.

    A batch norm takes away what a unit that is always active adds through its bias: the bias has gradient zero, of
    which rounding makes a random sign, and Adam a random step.
    """
    hidden = [head[1](head[0](x)) for x in inputs]
    last = head[2]
    for unit in range(last.out_features):
        while any((last(x)[:, unit] > 0).float().mean() in (0.0, 1.0) for x in hidden):
            spare = nn.Linear(last.in_features, 1)
            draw_linear(spare)
            last.weight.data[unit], last.bias.data[unit] = spare.weight.data[0], spare.bias.data[0]


def draw(cfg):
    """An agent and a batch, both in f32, from the configuration's seed.

    Targets are draws of their own and no copies, so that a mix-up shows.
    """
    torch.manual_seed(cfg.seed)
    agent, batch = METHODS[cfg.method](cfg), draw_batch(cfg)
    draw_weights(agent)
    for module in agent.modules():
        if isinstance(module, Encoder):
            redraw_until_lively(module, batch["obs"][0])
    if cfg.method == "curl":
        nn.init.uniform_(agent.bilinear)
    if cfg.method == "pi-sac":
        x, y0, y1 = agent.head_inputs(batch)
        redraw_always_active(agent.forward_head, [x])
        redraw_always_active(agent.backward_head, [y0, y1])
    return agent, batch


def in_f64(agent, batch):
    """Copies of both in f64; images and indices stay as they are."""
    double = {name: x.double() if x.is_floating_point() else x for name, x in batch.items()}
    return copy.deepcopy(agent).double(), double


# Fixtures


NO_EFFECT = ("forward_head.4.bias", "backward_head.4.bias")  # a batch norm follows: their gradient is zero


class Unsuitable(Exception):
    """A draw that another implementation in f32 could not follow."""


def require(condition, message):
    if not condition:
        raise Unsuitable(message)


def require_clear_signs(name, gradient):
    """No entry may be so small beside the largest that f32 could lose its sign, which is all Adam's first step sees."""
    if name in NO_EFFECT:
        return
    size = gradient.abs()
    require(not ((size > 0) & (size < 1e-5 * size.max())).any(), f"tiny gradient in {name}")


class AwayFromKinks(TorchFunctionMode):
    """Refuses a computation in which a ReLU, a minimum or a smooth L1 comes within 1e-6 of its kink."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        name = getattr(func, "__name__", "")
        if name == "relu":
            self.require_distance(name, args[0])
        elif name == "minimum":
            self.require_distance(name, args[0] - args[1])
        elif name == "smooth_l1_loss":
            self.require_distance(name, (args[0] - args[1]).abs() - 1)
        return func(*args, **(kwargs or {}))

    def require_distance(self, name, x):
        require(x.abs().min() > 1e-6, f"{name} at its kink")


def gradients(agent, loss, groups):
    """The loss's gradient by name, for every parameter of the networks that it trains."""
    parameters = agent.trainable(*groups)
    found = dict(zip(parameters, torch.autograd.grad(loss, list(parameters.values()), retain_graph=True)))
    for name in set(NO_EFFECT) & set(found):
        found[name] = torch.zeros_like(found[name])
    return found


def record(agent, batch):
    """Weights, values, gradients and the weights after one update, by the names of the fixture."""
    out = {f"before.{name}": p.detach().clone() for name, p in agent.named_parameters()}
    losses, values = agent.losses(batch)
    out |= {f"value.{name}_loss": loss.detach() for name, loss in losses.items()}
    out |= {f"value.{name}": value.detach() for name, value in values.items()}
    for loss_name, loss in losses.items():
        found = gradients(agent, loss, agent.trained_by[loss_name])
        out |= {f"gradient.{loss_name}.{name}": gradient for name, gradient in found.items()}
    agent.update(batch)
    return out | {f"after.{name}": p.detach().clone() for name, p in agent.named_parameters()}


def record_exactly(agent, batch):
    """The record in f64, of a draw that keeps away from kinks, has clear signs, and moves every parameter."""
    agent, batch = in_f64(agent, batch)
    names = {p: name for name, p in agent.named_parameters()}

    def watch(optimiser, args, kwargs):
        for p in optimiser.param_groups[0]["params"]:
            require_clear_signs(names[p], p.grad)

    handle = register_optimizer_step_pre_hook(watch)
    try:
        with AwayFromKinks():
            out = record(agent, batch)
    finally:
        handle.remove()
    for name, value in out.items():
        group, _, parameter = name.partition(".")
        if group == "gradient":
            require_clear_signs(parameter.partition(".")[2], value)
        elif group == "after" and parameter not in NO_EFFECT:
            require(not value.equal(out[f"before.{parameter}"]), f"{parameter} ends where it began")
    return out


def deviation(found, expected):
    """The largest difference beside the largest magnitude."""
    return ((found - expected).abs().max() / expected.abs().max().clamp(min=1e-30)).item()


def require_f32_agrees(single, exact):
    """The same statement in f32 must follow far within the tolerance that the fixtures are meant for (1e-5)."""
    for name, value in exact.items():
        if not name.endswith(NO_EFFECT):
            require(deviation(single[name].double(), value) < 2e-6, f"f32 differs in {name}")


def fixture(cfg):
    """All tensors of one fixture."""
    agent, batch = draw(cfg)
    exact = record_exactly(agent, batch)
    require_f32_agrees(record(agent, batch), exact)
    out = {f"input.{name}": x.to(torch.uint32) if x.dtype == torch.int64 else x for name, x in batch.items()}
    return out | {name: value.float() for name, value in exact.items()}


def make():
    """Writes every fixture, from the first seed whose draw is suitable."""
    for name, case in CASES.items():
        for seed in itertools.count():
            cfg = dataclasses.replace(case, seed=seed)
            try:
                tensors = fixture(cfg)
            except Unsuitable as reason:
                print(f"{name}: seed {seed}: {reason}")
                continue
            tensors = {key: value.contiguous() for key, value in tensors.items()}
            save_file(tensors, HERE / f"{name}.safetensors", metadata={"config": cfg.as_json()})
            print(f"{name}: seed {seed}: {len(tensors)} tensors")
            break


# Checks


def close(found, expected):
    """Agreement to the eight decimals that the golden numbers are given with."""
    found, expected = torch.as_tensor(found), torch.as_tensor(expected)
    assert (found - expected).abs().max() < 6e-9, (found, expected)


def check_golden_numbers():
    """Numbers computed from the same equations with numpy."""
    log_std = bounded_log_std(torch.tensor([0.1, -0.4]), -10, 2)
    close(log_std, [-3.40199203, -6.27969377])
    action, log_prob = tanh_gaussian(torch.tensor([0.3, -1.2]), log_std, torch.tensor([0.5, -1.0]))
    close(action, [0.30647781, -0.83422531])
    close(log_prob, [8.50794947])
    close(log_jacobian(torch.tensor(12.0)), -22.61370564)

    queries, keys = torch.tensor([[1.0, 0], [0, 1], [1, 1]]), torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.5, 0.5]])
    close(contrastive_loss(queries, keys, torch.tensor([[0.5, 0.2], [0.1, 0.7]])), 0.99927685)

    forward, noise = torch.tensor([[0.2, -0.1], [0.4, 0.3], [-0.5, 0.6]]), [[0.1, -0.2], [0.3, 0], [-0.4, 0.2]]
    backward0 = torch.tensor([[0.25, -0.3], [0.6, 0.2], [-0.7, 0.9]])
    backward1 = torch.tensor([[0.1, 0], [0.5, 0.5], [-0.2, 0.3]])
    terms = ceb_terms(forward, torch.tensor(noise), backward0, backward1)
    close(terms[1].mean(), 0.45125445)
    close(ceb_loss(*terms, 0.01, 0.6), -0.45109029)

    latent, rewards = torch.tensor([[0.5, -1], [2, 0.3], [-0.4, 0.8]]), torch.tensor([[1.0], [0], [0.5]])
    mean, sigma = torch.tensor([[0.2, 0.1], [1.5, -0.3], [0, 0.4]]), torch.tensor([[1, 0.5], [0.8, 0.9], [0.3, 0.2]])
    close(bisimulation_loss(latent, rewards, mean, sigma, torch.tensor([2, 0, 1]), 0.99), 0.41329052)
    close(transition_loss(mean, sigma, torch.tensor([[0.1, 0.3], [1, 0.2], [0.4, -0.1]])), 0.10224340)


class FrozenDetach(TorchFunctionMode):
    """Gives every detached tensor the value it had in the first pass, so that differences see what gradients see."""

    def __init__(self):
        super().__init__()
        self.values, self.next = [], 0

    def __torch_function__(self, func, types, args=(), kwargs=None):
        if func is not torch.Tensor.detach:
            return func(*args, **(kwargs or {}))
        if self.next == len(self.values):
            self.values.append(func(*args).clone())
        self.next += 1
        return self.values[self.next - 1]


def directional_difference(agent, batch, loss_name, parameter, direction, frozen, step=1e-6):
    """Central difference of one loss along a direction of one parameter."""
    values = []
    start = parameter.data.clone()
    for sign in (1, -1):
        parameter.data = start + sign * step * direction
        frozen.next = 0
        with frozen:
            values.append(agent.losses(batch)[0][loss_name].item())
    parameter.data = start
    return (values[0] - values[1]) / (2 * step)


def check_gradients(name, agent, batch):
    """Every gradient of every loss against finite differences along random directions."""
    frozen, worst = FrozenDetach(), 0.0
    with frozen:
        losses, _ = agent.losses(batch)
    for loss_name, loss in losses.items():
        for key, gradient in gradients(agent, loss, agent.trained_by[loss_name]).items():
            parameter, direction = agent.get_parameter(key), torch.randn_like(gradient)
            direction /= direction.norm()
            slope = directional_difference(agent, batch, loss_name, parameter, direction, frozen)
            error = abs(slope - (gradient * direction).sum().item()) / (gradient.norm().item() + 1e-3)
            assert error < 1e-5, (name, loss_name, key, error)
            worst = max(worst, error)
    print(f"{name}: gradients agree with finite differences to {worst:.1e}")


def load(path):
    """Configuration and tensors of a fixture."""
    with safe_open(path, "pt") as file:
        cfg = json.loads(file.metadata()["config"])
        return Config(**cfg), {key: file.get_tensor(key) for key in file.keys()}


def check_fixture(name):
    """Finite numbers, the names that the statement gives today, and its numbers from the stored weights and inputs."""
    cfg, tensors = load(HERE / f"{name}.safetensors")
    part = {prefix: {key.split(".", 1)[1]: x for key, x in tensors.items() if key.startswith(prefix)}
            for prefix in ("input.", "before.")}
    agent = METHODS[cfg.method](cfg)
    agent.load_state_dict(part["before."])
    batch = {key: x.long() if x.dtype == torch.uint32 else x for key, x in part["input."].items()}
    agent, batch = in_f64(agent, batch)
    check_gradients(name, agent, batch)
    exact = record(agent, batch)
    assert set(exact) == {key for key in tensors if not key.startswith("input.")}, name
    for key, value in exact.items():
        assert tensors[key].isfinite().all() and deviation(tensors[key].double(), value) < 1e-7, (name, key)
    print(f"{name}: {len(tensors)} tensors as the statement gives them")


def check():
    torch.set_default_dtype(torch.float64)
    check_golden_numbers()
    print("golden numbers agree")
    for name in CASES:
        check_fixture(name)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("make", "check"))
    torch.set_num_threads(1)
    {"make": make, "check": check}[parser.parse_args().command]()


if __name__ == "__main__":
    main()
