# %% [markdown]
# # What do the encoders know of your task?
#
# Trains in a task of one's own, whose `info` tells the truth, and asks with linear maps how well the latents predict
# it. With `--quick` it takes seconds and learns nothing.

# %%
import sys

import gymnasium
import hksl
import numpy as np
from gymnasium import spaces

QUICK = "--quick" in sys.argv


# %% [markdown]
# The task: follow a light that walks along a line, by pushing a cart. The image shows both; `info` says where they are.


# %%
class Follow(gymnasium.Env):
    """Rewards 1 where the cart is below the light, less further away."""

    side, limit = 32, 100
    observation_space = spaces.Box(0, 255, (side, side, 3), np.uint8)
    action_space = spaces.Box(-2.0, 2.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.light, self.cart = self.np_random.uniform(4, self.side - 4, size=2)
        self.steps = 0
        return self.frame(), self.truth()

    def step(self, action):
        self.cart = float(np.clip(self.cart + action[0], 1, self.side - 2))
        self.light = float(np.clip(self.light + self.np_random.normal(0, 1), 1, self.side - 2))
        self.steps += 1
        reward = 1.0 - abs(self.light - self.cart) / self.side
        return self.frame(), reward, False, self.steps == self.limit, self.truth()

    def truth(self):
        return {"light": self.light, "cart": self.cart, "gap": self.light - self.cart}

    def frame(self):
        frame = np.zeros((self.side, self.side, 3), np.uint8)
        frame[2:5, int(self.light) - 1 : int(self.light) + 2] = (255, 255, 0)
        frame[-4:-1, int(self.cart) - 1 : int(self.cart) + 2] = (0, 128, 255)
        return frame


# %% [markdown]
# hksl needs a time limit, to know how long episodes are. `TimeLimit` states the task's own.


# %%
def follow():
    return gymnasium.wrappers.TimeLimit(Follow(), Follow.limit)


settings = {"evaluation.every_environment_steps": 1_000, "checkpoint.weights_every_environment_steps": 1_000}
if QUICK:
    training = hksl.train(follow, preset="debug", config={"environment.episode_steps": 80})
else:
    training = hksl.train(follow, preset="small", environment_steps=10_000, config=settings)

# %% [markdown]
# The probe: ten episodes of random actions to fit the linear maps on, five to test them. An error near the constant's
# says that the latents know nothing of the quantity.

# %%
for row in hksl.probe(training.folder, follow, ["light", "cart", "gap"], horizons=[1, 3]):
    errors = ", ".join(f"{error:.2f}" for error in row["mse_by_coordinate"])
    print(f"{row['encoder']:>8}, {row['horizon']} ahead: light, cart, gap = {errors}; constant {row['constant_mse']:.2f}")
