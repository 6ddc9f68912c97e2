"""An independent PyTorch statement of DreamerV2 for continuous control from pixels, and its golden fixtures.

    python dreamer_torch.py make     writes dreamer-paper.safetensors and dreamer-original.safetensors beside this file
    python dreamer_torch.py check    asserts known numbers of the functions that the statement is made of

Needs torch, numpy and safetensors. Weights and inputs are drawn in f32, all is computed in f64 and stored in f32.

Shapes: B sequences of T images (C, H, W), N = B*T start states (number b*T + t), A action dimensions, V categorical
variables of K classes each (flat order: variable-major), D deter, feature = [stoch (V*K) | deter (D)], horizon L.

A fixture holds
  <param>             every parameter before the learning step, under the name that `Dreamer.named_parameters` gives it;
  input.*             the batch and all uniform random numbers (see `draw_inputs`);
  value.*             what the losses are made of, at those parameters (see `WorldPass` and `BehaviourPass`);
  gradient.world.*    of world_loss, before clipping, for every parameter of encoder, decoder, rssm and reward;
  gradient.actor.*    of actor_loss, and gradient.critic.* of critic_loss, before clipping, at those parameters too;
  after.<param>       every parameter after one whole learning step (see `Dreamer.train_step`);
  step.*              of that step: actor_loss and critic_loss (of the imagination with the new world model), and
                      norm.world, norm.actor, norm.critic, the global gradient norms before clipping.
"""

import argparse
import itertools
import json
import math
import pathlib
from dataclasses import dataclass, fields

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import nn

CONSTANTS = {
    "discount": 0.99, "lambda": 0.95, "entropy_scale": 1e-4, "kl_balance": 0.8, "free_nats": 0.05,
    "free_nats_large": 1e3, "world_lr": 3e-4, "actor_lr": 8e-5, "critic_lr": 8e-5, "beta1": 0.9, "beta2": 0.999,
    "adam_eps": 1e-5, "clip": 100.0, "decay": 1e-6, "action_clip": 1e-6, "norm_eps": 1e-5, "gru_norm_eps": 1e-3,
}
CASES = {  # `seed` is where the search for a usable seed starts, in a fixture the one that was used
    "paper": {
        "seed": 2924, "obs": (3, 20, 17), "action": 2, "filters": 4, "latent": 6, "deter": 10, "rssm_hidden": 9,
        "variables": 3, "classes": 4, "hidden": 16, "mlp_hidden": 8, "batch": 3, "length": 4, "horizon": 5,
    },
    "original": {
        "seed": 2, "obs": (3, 64, 64), "action": 1, "depth": 2, "deter": 8, "rssm_hidden": 7, "variables": 2,
        "classes": 3, "mlp_hidden": 8, "batch": 3, "length": 4, "horizon": 5,
    },
}
HALF_LOG_TWO_PI = 0.5 * math.log(2 * math.pi)


# ---------------------------------------------------------------------------------------------- plain functions


def normal_nll(prediction, target):
    """-ln N(target; prediction, 1) element by element, constant included."""
    return 0.5 * (target - prediction) ** 2 + HALF_LOG_TWO_PI


def categorical_sample(logits, uniform):
    """One-hot of the first class whose cumulative probability exceeds `uniform` (logits without the class axis)."""
    cumulative = logits.softmax(-1).cumsum(-1)
    index = (cumulative > uniform[..., None]).to(torch.uint8).argmax(-1)
    return F.one_hot(index, logits.shape[-1]).to(logits.dtype)


def straight_through(one_hot, logits):
    """The value of the sample with the gradient of the probabilities."""
    probabilities = logits.softmax(-1)
    return one_hot + (probabilities - probabilities.detach())


def categorical_kl(logits, other):
    """KL(logits || other) summed over the variables: (..., V, K) -> (...)."""
    log_p, log_q = logits.log_softmax(-1), other.log_softmax(-1)
    return (log_p.exp() * (log_p - log_q)).sum((-1, -2))


def kl_term(posterior, prior, balance, free_nats):
    """Balanced KL; the free nats bound the batch mean of each side, so that a side below them has no gradient."""
    to_posterior = categorical_kl(posterior, prior.detach()).mean()
    to_prior = categorical_kl(posterior.detach(), prior).mean()
    return (1 - balance) * to_posterior.clamp(min=free_nats) + balance * to_prior.clamp(min=free_nats)


def lambda_return(rewards, values, discount, lam):
    """G_t = r_t + d * ((1 - lambda) * v_{t+1} + lambda * G_{t+1}), G_L = v_L, for t = 0..L-1 (time is the last axis).

    `values` has L+1 entries; of `rewards` the first L are used: r_t is the reward of being at state t.
    """
    following, out = values[..., -1], []
    for t in reversed(range(values.shape[-1] - 1)):
        following = rewards[..., t] + discount * ((1 - lam) * values[..., t + 1] + lam * following)
        out.append(following)
    return torch.stack(out[::-1], -1)


class TruncatedNormal:
    """Normal(loc, std) restricted to [-1, 1], every dimension on its own."""

    def __init__(self, loc, std):
        self.loc, self.std = loc, std
        self.alpha, self.beta = (-1 - loc) / std, (1 - loc) / std
        self.below = torch.special.ndtr(self.alpha)
        self.mass = torch.special.ndtr(self.beta) - self.below

    @classmethod
    def of_actor(cls, output):
        """From the actor's 2A outputs: loc = tanh(first half), std = 2 * sigmoid(second half / 2) + 0.1."""
        mean, raw = output.chunk(2, -1)
        return cls(mean.tanh(), 2 * torch.sigmoid(raw / 2) + 0.1)

    def sample(self, uniform):
        """The quantile of `uniform`; clipped just inside the interval, with the gradient of the unclipped value."""
        x = self.loc + self.std * torch.special.ndtri(self.below + uniform * self.mass)
        bound = 1 - CONSTANTS["action_clip"]
        return x.detach().clamp(-bound, bound) + (x - x.detach())

    def log_density(self, x):
        return -0.5 * ((x - self.loc) / self.std) ** 2 - HALF_LOG_TWO_PI - self.std.log() - self.mass.log()

    def entropy(self):
        """Per dimension: ln(sqrt(2 pi e) s Z) + (alpha phi(alpha) - beta phi(beta)) / (2 Z)."""
        def weighted(x):
            return x * torch.exp(-0.5 * x**2 - HALF_LOG_TWO_PI)

        tails = (weighted(self.alpha) - weighted(self.beta)) / (2 * self.mass)
        return HALF_LOG_TWO_PI + 0.5 + (self.std * self.mass).log() + tails


# ---------------------------------------------------------------------------------------------- networks


def mlp(inputs, hidden, layers, outputs):
    """`layers` hidden linear layers with ELU, then a linear one; the linear layers are numbered 0, 2, 4, ..."""
    sizes = [inputs] + [hidden] * layers
    modules = [m for a, b in itertools.pairwise(sizes) for m in (nn.Linear(a, b), nn.ELU())]
    return nn.Sequential(*modules, nn.Linear(sizes[-1], outputs))


def after_conv(size, kernel, stride):
    return (size - kernel) // stride + 1


class PaperEncoder(nn.Module):
    """Pixels / 255 -> four 3x3 convs (strides 2,1,1,1; ReLU after each) -> linear -> layer norm -> (.., latent)."""

    def __init__(self, cfg):
        super().__init__()
        channels, filters = cfg["obs"][0], cfg["filters"]
        self.convs = nn.ModuleList(
            nn.Conv2d(channels if i == 0 else filters, filters, 3, stride=2 if i == 0 else 1) for i in range(4)
        )
        rows, columns = self.map_size(cfg["obs"])
        self.linear = nn.Linear(filters * rows * columns, cfg["latent"])
        self.norm = nn.LayerNorm(cfg["latent"], eps=CONSTANTS["norm_eps"])
        self.size = cfg["latent"]

    @staticmethod
    def map_size(obs):
        """Rows and columns after the four convs."""
        return tuple(after_conv(size, 3, 2) - 6 for size in obs[1:])

    def forward(self, pixels):
        x = pixels / 255
        for conv in self.convs:
            x = conv(x).relu()
        return self.norm(self.linear(x.flatten(1)))


class PaperDecoder(nn.Module):
    """The mirrored encoder: linear ReLU, three transposed 3x3 convs ReLU, a transposed 3x3 conv of stride 2."""

    def __init__(self, cfg, feature):
        super().__init__()
        channels, *image = cfg["obs"]
        filters, rows_columns = cfg["filters"], PaperEncoder.map_size(cfg["obs"])
        self.shape = (filters, *rows_columns)
        self.start = nn.Linear(feature, math.prod(self.shape))
        padding = tuple(size - (2 * (start + 6 - 1) + 3) for size, start in zip(image, rows_columns))
        self.layers = nn.ModuleList(nn.ConvTranspose2d(filters, filters, 3) for _ in range(3))
        self.layers.append(nn.ConvTranspose2d(filters, channels, 3, stride=2, output_padding=padding))

    def forward(self, feature):
        x = self.start(feature).relu().unflatten(-1, self.shape)
        for layer in self.layers[:-1]:
            x = layer(x).relu()
        return self.layers[-1](x)


class OriginalEncoder(nn.Module):
    """Pixels / 255 - 0.5 -> four 4x4 convs of stride 2 with ELU -> the flattened maps (channel, row, column)."""

    def __init__(self, cfg):
        super().__init__()
        sizes = [cfg["obs"][0]] + [cfg["depth"] * 2**i for i in range(4)]
        self.layers = nn.ModuleList(nn.Conv2d(a, b, 4, stride=2) for a, b in itertools.pairwise(sizes))
        rows, columns = cfg["obs"][1:]
        for _ in self.layers:
            rows, columns = after_conv(rows, 4, 2), after_conv(columns, 4, 2)
        self.size = sizes[-1] * rows * columns

    def forward(self, pixels):
        x = pixels / 255 - 0.5
        for layer in self.layers:
            x = F.elu(layer(x))
        return x.flatten(1)


class OriginalDecoder(nn.Module):
    """Linear -> (32d, 1, 1) without activation, transposed convs 5,5,6,6 of stride 2 with ELU between them."""

    def __init__(self, cfg, feature):
        super().__init__()
        depth = cfg["depth"]
        sizes = [32 * depth, 4 * depth, 2 * depth, depth, cfg["obs"][0]]
        self.start = nn.Linear(feature, sizes[0])
        self.layers = nn.ModuleList(
            nn.ConvTranspose2d(a, b, kernel, stride=2)
            for (a, b), kernel in zip(itertools.pairwise(sizes), (5, 5, 6, 6))
        )

    def forward(self, feature):
        x = self.start(feature)[..., None, None]
        for layer in self.layers[:-1]:
            x = F.elu(layer(x))
        return self.layers[-1](x)


class Rssm(nn.Module):
    """The recurrent state-space model with categorical latents; a state is (stoch (.., V*K), deter (.., D))."""

    def __init__(self, cfg, embedding):
        super().__init__()
        self.shape = (cfg["variables"], cfg["classes"])
        stoch, deter, hidden = math.prod(self.shape), cfg["deter"], cfg["rssm_hidden"]
        self.input = nn.Linear(stoch + cfg["action"], hidden)
        self.gru = nn.Linear(hidden + deter, 3 * deter)
        self.gru_norm = nn.LayerNorm(3 * deter, eps=CONSTANTS["gru_norm_eps"])
        self.prior_hidden = nn.Linear(deter, hidden)
        self.prior = nn.Linear(hidden, stoch)
        self.posterior_hidden = nn.Linear(deter + embedding, hidden)
        self.posterior = nn.Linear(hidden, stoch)

    def advance(self, stoch, deter, action):
        """The next deter: the reset gate scales the candidate, and the update gate is biased by -1."""
        x = F.elu(self.input(torch.cat([stoch, action], -1)))
        reset, candidate, update = self.gru_norm(self.gru(torch.cat([x, deter], -1))).chunk(3, -1)
        candidate = torch.tanh(torch.sigmoid(reset) * candidate)
        update = torch.sigmoid(update - 1)
        return update * candidate + (1 - update) * deter

    def prior_logits(self, deter):
        return self.prior(F.elu(self.prior_hidden(deter))).unflatten(-1, self.shape)

    def posterior_logits(self, deter, embedding):
        hidden = F.elu(self.posterior_hidden(torch.cat([deter, embedding], -1)))
        return self.posterior(hidden).unflatten(-1, self.shape)

    @staticmethod
    def sample(logits, uniform):
        """Straight-through one-hots of all variables, flat."""
        return straight_through(categorical_sample(logits, uniform), logits).flatten(-2)


# ---------------------------------------------------------------------------------------------- the agent


@dataclass
class WorldPass:
    """The world model on a batch: everything (B, T, ..), the losses scalar.

    image_loss and reward_loss are negative log-likelihoods of unit-variance normals (constants included), summed over
    pixels and channels, mean over B and T. kl_loss uses `free_nats`, kl_loss_free `free_nats_large`.
    world_loss = image_loss + reward_loss + kl_loss.
    """

    embedding: torch.Tensor
    posterior_logits: torch.Tensor
    prior_logits: torch.Tensor
    stoch: torch.Tensor
    deter: torch.Tensor
    reconstruction: torch.Tensor
    reward: torch.Tensor
    image_loss: torch.Tensor
    reward_loss: torch.Tensor
    kl_loss: torch.Tensor
    kl_loss_free: torch.Tensor
    world_loss: torch.Tensor


@dataclass
class Imagination:
    """Trajectories of the actor: states 0..L, and the action and entropy (summed over A) at states 0..L-1.

    prior_logits[:, k] are the logits from which the stoch of state k+1 was drawn.
    """

    features: torch.Tensor
    actions: torch.Tensor
    entropy: torch.Tensor
    prior_logits: torch.Tensor


@dataclass
class BehaviourPass:
    """Actor and critic on imagined trajectories: rewards and values (of the slow critic) (N, L+1), returns (N, L).

    actor_loss  = -mean over N and k = 0..L-2 of  d^k * (G_{k+1} + entropy_scale * entropy_k)
    critic_loss =  mean over N and t = 0..L-1 of  d^t * 0.5 * (v(feature_t) - G_t)^2, without the normal's constant
    entropy     =  mean over N and k = 0..L-2 of entropy_k, without weights
    """

    imagined_actions: torch.Tensor
    imagined_rewards: torch.Tensor
    imagined_values: torch.Tensor
    returns: torch.Tensor
    entropy: torch.Tensor
    actor_loss: torch.Tensor
    critic_loss: torch.Tensor


class Dreamer(nn.Module):
    """All networks of one agent, its losses and one learning step."""

    def __init__(self, cfg):
        super().__init__()
        self.cfg = cfg
        paper = cfg["preset"] == "paper"
        feature = cfg["variables"] * cfg["classes"] + cfg["deter"]
        hidden, layers = (cfg["hidden"], 2) if paper else (cfg["mlp_hidden"], 4)
        self.encoder = PaperEncoder(cfg) if paper else OriginalEncoder(cfg)
        self.decoder = PaperDecoder(cfg, feature) if paper else OriginalDecoder(cfg, feature)
        self.rssm = Rssm(cfg, self.encoder.size)
        self.reward = mlp(feature, cfg["mlp_hidden"], 4, 1)
        self.actor = mlp(feature, hidden, layers, 2 * cfg["action"])
        self.critic = mlp(feature, hidden, layers, 1)
        self.targets = nn.ModuleDict({"critic": mlp(feature, hidden, layers, 1)})

    def group(self, *names):
        """The parameters of the named networks, in order, by full name."""
        return {name: p for name, p in self.named_parameters() if name.split(".")[0] in names}

    def world_parameters(self):
        return self.group("encoder", "decoder", "rssm", "reward")

    def observe(self, embedding, actions, uniform):
        """Filters each sequence from the zero state.

        actions[:, t] led to image t; the first one is ignored, because at t = 0 previous state and action are zero.
        Returns posterior logits, prior logits (B, T, V, K), stoch (B, T, V*K) and deter (B, T, D).
        """
        batch, length = embedding.shape[:2]
        stoch = embedding.new_zeros(batch, math.prod(self.rssm.shape))
        deter = embedding.new_zeros(batch, self.cfg["deter"])
        steps = []
        for t in range(length):
            action = torch.zeros_like(actions[:, 0]) if t == 0 else actions[:, t]
            deter = self.rssm.advance(stoch, deter, action)
            posterior = self.rssm.posterior_logits(deter, embedding[:, t])
            stoch = self.rssm.sample(posterior, uniform[:, t])
            steps.append((posterior, self.rssm.prior_logits(deter), stoch, deter))
        return [torch.stack(column, 1) for column in zip(*steps)]

    def world(self, inputs):
        """The world model's losses; encoder inputs differ by preset, the image target is x / 255 - 0.5 in both."""
        cfg, obs = self.cfg, inputs["obs"]
        embedding = self.encoder(obs.flatten(0, 1)).unflatten(0, obs.shape[:2])
        posterior, prior, stoch, deter = self.observe(embedding, inputs["actions"], inputs["uniform.posterior"])
        feature = torch.cat([stoch, deter], -1)
        reconstruction = self.decoder(feature.flatten(0, 1)).unflatten(0, obs.shape[:2])
        reward = self.reward(feature).squeeze(-1)
        image_loss = normal_nll(reconstruction, obs / 255 - 0.5).sum((-1, -2, -3)).mean()
        reward_loss = normal_nll(reward, inputs["rewards"]).mean()
        kl_loss, kl_loss_free = (
            kl_term(posterior, prior, cfg["kl_balance"], cfg[free]) for free in ("free_nats", "free_nats_large")
        )
        return WorldPass(embedding, posterior, prior, stoch, deter, reconstruction, reward, image_loss, reward_loss,
                         kl_loss, kl_loss_free, image_loss + reward_loss + kl_loss)

    def imagine(self, stoch, deter, inputs):
        """Rolls the actor out through the prior for L steps from (N, ..) detached states.

        At state k the actor sees the feature without gradient; its action k leads to state k+1. Gradients run from
        later states to earlier actions through the RSSM and its straight-through samples.
        """
        features, steps = [torch.cat([stoch, deter], -1)], []
        for k in range(self.cfg["horizon"]):
            policy = TruncatedNormal.of_actor(self.actor(features[-1].detach()))
            action = policy.sample(inputs["uniform.action"][:, k])
            deter = self.rssm.advance(stoch, deter, action)
            logits = self.rssm.prior_logits(deter)
            stoch = self.rssm.sample(logits, inputs["uniform.prior"][:, k])
            features.append(torch.cat([stoch, deter], -1))
            steps.append((action, policy.entropy().sum(-1), logits))
        return Imagination(torch.stack(features, 1), *(torch.stack(column, 1) for column in zip(*steps)))

    def behave(self, imagined):
        """Actor and critic losses; each is meant to be differentiated by its own network's parameters only."""
        cfg, horizon = self.cfg, self.cfg["horizon"]
        rewards = self.reward(imagined.features).squeeze(-1)
        values = self.targets["critic"](imagined.features).squeeze(-1)
        returns = lambda_return(rewards, values, cfg["discount"], cfg["lambda"])
        weights = cfg["discount"] ** torch.arange(horizon, dtype=returns.dtype)
        entropy = imagined.entropy[:, :-1]
        actor_loss = -(weights[:-1] * (returns[:, 1:] + cfg["entropy_scale"] * entropy)).mean()
        predicted = self.critic(imagined.features[:, :-1].detach()).squeeze(-1)
        critic_loss = (weights * 0.5 * (predicted - returns.detach()) ** 2).mean()
        return BehaviourPass(imagined.actions, rewards, values, returns, entropy.mean(), actor_loss, critic_loss)

    def apply_gradients(self, parameters, gradients, lr):
        """Clips to the global norm of all `gradients`, takes a first Adam step, then multiplies by (1 - decay)."""
        cfg = self.cfg
        for name, gradient in clip_global_norm(gradients, cfg["clip"]).items():
            parameters[name].grad = gradient
        torch.optim.Adam(parameters.values(), lr, (cfg["beta1"], cfg["beta2"]), cfg["adam_eps"]).step()
        with torch.no_grad():
            for parameter in parameters.values():
                parameter.mul_(1 - cfg["decay"])

    def train_step(self, inputs):
        """The first learning step of an agent; returns its behaviour pass and, by group, the unclipped gradients.

        The world model steps on the batch; the actor then imagines with the new world model from the posterior states
        found before that step; actor and critic step on losses that both precede either step; as this is the first
        update, the slow critic becomes a copy of the new critic.
        """
        world = self.world(inputs)
        world_gradients = gradients_of(world.world_loss, self.world_parameters())
        self.apply_gradients(self.world_parameters(), world_gradients, self.cfg["world_lr"])
        behaviour = self.behave(self.imagine(*start_states(world), inputs))
        actor_gradients = gradients_of(behaviour.actor_loss, self.group("actor"))
        critic_gradients = gradients_of(behaviour.critic_loss, self.group("critic"))
        self.apply_gradients(self.group("actor"), actor_gradients, self.cfg["actor_lr"])
        self.apply_gradients(self.group("critic"), critic_gradients, self.cfg["critic_lr"])
        self.targets["critic"].load_state_dict(self.critic.state_dict())
        return behaviour, {"world": world_gradients, "actor": actor_gradients, "critic": critic_gradients}


def start_states(world):
    """All posterior states of a batch, (N, ..), without gradient."""
    return world.stoch.detach().flatten(0, 1), world.deter.detach().flatten(0, 1)


def gradients_of(loss, parameters):
    return dict(zip(parameters, torch.autograd.grad(loss, parameters.values(), retain_graph=True)))


def global_norm(gradients):
    return torch.sqrt(sum((g**2).sum() for g in gradients.values()))


def clip_global_norm(gradients, limit):
    """Scales all gradients by limit / max(norm, limit), the norm being that of all of them together."""
    scale = limit / global_norm(gradients).clamp(min=limit)
    return {name: g * scale for name, g in gradients.items()}


# ---------------------------------------------------------------------------------------------- fixtures

DRAW_MARGIN = 1e-3
RELU_MARGIN = 1e-5
ADAM_MARGIN = 5e-7
GRADIENT_NOISE = 1e-6
DEAD_SHARE = 0.7


def draw_parameters(agent, generator):
    """Uniform within 1 / sqrt(fan_in), fan_in being the size of weight[0]; norms: 1 + 0.1 normal, 0.1 normal."""
    for name, module in agent.named_modules():
        if isinstance(module, nn.LayerNorm):
            for parameter, mean in ((module.weight, 1), (module.bias, 0)):
                draw = torch.randn(parameter.shape, dtype=torch.float32, generator=generator)
                parameter.data.copy_(mean + 0.1 * draw)
        elif hasattr(module, "weight"):
            bound = module.weight[0].numel() ** -0.5
            for parameter in (module.weight, module.bias):
                draw = torch.rand(parameter.shape, dtype=torch.float32, generator=generator)
                parameter.data.copy_(bound * (2 * draw - 1))


def draw_inputs(cfg, generator):
    """The batch and the uniform numbers of every draw.

    obs (B, T, C, H, W) u8; actions (B, T, A): actions[:, t] led to image t; rewards (B, T): received on arriving at
    image t; uniform.posterior (B, T, V); uniform.prior (N, L, V): for the stoch of states 1..L; uniform.action
    (N, L, A): for the actions at states 0..L-1. The first action number is 0, where the sample has to be clipped.
    """
    def uniform(*shape):
        return torch.rand(shape, dtype=torch.float32, generator=generator)

    batch, length, horizon, variables = cfg["batch"], cfg["length"], cfg["horizon"], cfg["variables"]
    level, grain = uniform(batch, length, cfg["obs"][0], 1, 1), uniform(batch, length, *cfg["obs"])
    action_numbers = uniform(batch * length, horizon, cfg["action"])
    action_numbers[0, 0, 0] = 0.0
    return {
        "obs": (192 * level + 64 * grain).to(torch.uint8),
        "actions": 2 * uniform(batch, length, cfg["action"]) - 1,
        "rewards": torch.randn((batch, length), dtype=torch.float32, generator=generator),
        "uniform.posterior": uniform(batch, length, variables),
        "uniform.prior": uniform(batch * length, horizon, variables),
        "uniform.action": action_numbers,
    }


def draw_case(cfg, seed):
    """A fresh agent and its inputs in the default dtype."""
    generator = torch.Generator().manual_seed(seed)
    agent = Dreamer(cfg)
    draw_parameters(agent, generator)
    inputs = {name: x.to(torch.get_default_dtype()) for name, x in draw_inputs(cfg, generator).items()}
    return agent, inputs


def draw_margin(logits, uniform):
    """Smallest distance of a uniform number from a class boundary."""
    return (logits.softmax(-1).cumsum(-1) - uniform[..., None]).abs().min().item()


def relu_margin(agent, inputs):
    """Smallest distance from zero of anything that a ReLU is applied to (infinite where there is none)."""
    if agent.cfg["preset"] != "paper":
        return math.inf
    seen = []
    modules = [*agent.encoder.convs, agent.decoder.start, *agent.decoder.layers[:-1]]
    hooks = [m.register_forward_hook(lambda _, __, out: seen.append(out.abs().min().item())) for m in modules]
    agent.world(inputs)
    for hook in hooks:
        hook.remove()
    return min(seen)


def adam_margin(gradients, cfg):
    """Largest change of a first Adam step if each gradient that is not exactly zero (behind a dead ReLU) moves by
    GRADIENT_NOISE times the largest one of its tensor."""
    def step(g, lr):
        return lr * g / (g.abs() + cfg["adam_eps"])

    worst = 0.0
    for group, raw in gradients.items():
        lr = cfg[f"{group}_lr"]
        for g in clip_global_norm(raw, cfg["clip"]).values():
            noise = GRADIENT_NOISE * g.abs().max() * (g != 0)
            for moved in (g + noise, g - noise):
                worst = max(worst, (step(moved, lr) - step(g, lr)).abs().max().item())
    return worst


def dead_share(gradients):
    """The largest share of a tensor's gradient that is exactly zero."""
    return max((g == 0).double().mean().item() for group in gradients.values() for g in group.values())


def is_robust(agent, inputs, world, imagined):
    """True if rounding in f32 cannot draw another class, switch a ReLU or a free-nats bound."""
    draws = min(
        draw_margin(world.posterior_logits, inputs["uniform.posterior"]),
        draw_margin(imagined.prior_logits, inputs["uniform.prior"]),
    )
    kl = categorical_kl(world.posterior_logits, world.prior_logits).mean().item()
    return draws > DRAW_MARGIN and relu_margin(agent, inputs) > RELU_MARGIN and kl > 1.2 * agent.cfg["free_nats"]


def make_case(cfg, seed):
    """The tensors of one fixture, or None where this seed's draws are not robust or leave too many units dead."""
    agent, inputs = draw_case(cfg, seed)
    world = agent.world(inputs)
    imagined = agent.imagine(*start_states(world), inputs)
    if not is_robust(agent, inputs, world, imagined):
        return None
    behaviour = agent.behave(imagined)
    out = {name: p.detach().clone() for name, p in agent.named_parameters()}
    out.update({f"input.{name}": x for name, x in inputs.items()})
    for result in (world, behaviour):
        out.update({f"value.{field.name}": getattr(result, field.name).detach() for field in fields(result)})
    free = torch.autograd.grad(world.kl_loss_free, world.posterior_logits, retain_graph=True)[0]
    assert world.kl_loss_free.item() == cfg["free_nats_large"] and free.abs().max().item() == 0.0
    for group, loss, parameters in (
        ("world", world.world_loss, agent.world_parameters()),
        ("actor", behaviour.actor_loss, agent.group("actor")),
        ("critic", behaviour.critic_loss, agent.group("critic")),
    ):
        out.update({f"gradient.{group}.{name}": g for name, g in gradients_of(loss, parameters).items()})
    behaviour, gradients = agent.train_step(inputs)
    if adam_margin(gradients, cfg) > ADAM_MARGIN or dead_share(gradients) > DEAD_SHARE:
        return None
    imagined = agent.imagine(*start_states(world), inputs)
    if draw_margin(imagined.prior_logits, inputs["uniform.prior"]) < DRAW_MARGIN:
        return None
    out.update({f"after.{name}": p.detach() for name, p in agent.named_parameters()})
    out.update({f"step.{name}": getattr(behaviour, name).detach() for name in ("actor_loss", "critic_loss")})
    out.update({f"step.norm.{group}": global_norm(g) for group, g in gradients.items()})
    return out


def stored(name, tensor):
    """As written to the file: images as u8, everything else as f32."""
    return tensor.to(torch.uint8 if name == "input.obs" else torch.float32).contiguous()


def make():
    """Writes every fixture, from the first seed that serves, counted from the one in CASES."""
    folder = pathlib.Path(__file__).parent
    for preset, sizes in CASES.items():
        cfg = {"method": "dreamer-v2", "preset": preset, **sizes, **CONSTANTS}
        cases = ((seed, make_case(cfg, seed)) for seed in itertools.count(sizes["seed"]))
        cfg["seed"], tensors = next((seed, tensors) for seed, tensors in cases if tensors is not None)
        assert all(x.isfinite().all() for x in tensors.values())
        path = folder / f"dreamer-{preset}.safetensors"
        save_file({k: stored(k, x) for k, x in tensors.items()}, path, metadata={"config": json.dumps(cfg)})
        print(f"{path.name}: seed {cfg['seed']}, {len(tensors)} tensors, {path.stat().st_size} bytes")


# ---------------------------------------------------------------------------------------------- known numbers


def assert_close(actual, expected):
    torch.testing.assert_close(actual.detach(), torch.tensor(expected), rtol=0, atol=1e-8)


def check_lambda_return():
    returns = lambda_return(torch.tensor([1.0, 2.0, 3.0]), torch.tensor([10.0, 11.0, 12.0, 13.0]), 0.99, 0.95)
    assert_close(returns, [18.02181077, 17.51973500, 15.87])


def check_kl():
    posterior = torch.tensor([[[0.7, 0.2, 0.1]]]).log().requires_grad_()
    prior = torch.tensor([[[0.3, 0.3, 0.4]]]).log().requires_grad_()
    assert_close(categorical_kl(posterior, prior), [0.37338604])
    term = kl_term(posterior, prior, 0.8, 0.0)
    assert_close(term, 0.37338604)
    assert all(g.abs().max() > 0 for g in torch.autograd.grad(term, (posterior, prior)))
    term = kl_term(posterior, prior, 0.8, 1.0)
    assert_close(term, 1.0)
    assert all(g.abs().max() == 0 for g in torch.autograd.grad(term, (posterior, prior)))


def check_truncated_normal():
    policy = TruncatedNormal(torch.tensor(0.4), torch.tensor(0.6))
    x = policy.sample(torch.tensor(0.3))
    assert_close(x, 0.01264914)
    assert_close(policy.log_density(x), -0.43201415)
    assert_close(policy.entropy(), 0.54133663)
    assert_close(policy.sample(torch.tensor(0.0)), -0.999999)


def check():
    """Asserts the known numbers."""
    check_lambda_return()
    check_kl()
    check_truncated_normal()
    print("all known numbers agree")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("make", "check"))
    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(1)
    {"make": make, "check": check}[parser.parse_args().command]()


if __name__ == "__main__":
    main()
