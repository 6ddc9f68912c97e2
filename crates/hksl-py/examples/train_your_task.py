# %% [markdown]
# # HKSL on a task of your own
#
# Each part runs alone in a notebook (the lines `# %%` divide them), and all together as a script. With `--quick` it
# takes seconds and learns nothing; without, about an hour on two cores.

# %%
import sys

import gymnasium
import hksl
from gymnasium.wrappers import AddRenderObservation, FrameStackObservation, ResizeObservation

QUICK = "--quick" in sys.argv


# %% [markdown]
# The task: any Gymnasium environment whose observations are images. This one shows the pendulum only in pixels, and
# frames of 84×84. hksl stacks three of them, because one frame hides velocities.


# %%
def pendulum():
    env = gymnasium.make("Pendulum-v1", render_mode="rgb_array")
    return ResizeObservation(AddRenderObservation(env), (84, 84))


# %% [markdown]
# Training. Stop it as often as you like: the same call resumes the run.

# %%
SMALL = {"sac.batch_size": 64, "environment.action_repeat": 2, "evaluation.every_environment_steps": 5_000}
if QUICK:
    training = hksl.train(pendulum, preset="debug")
else:
    training = hksl.train(pendulum, preset="small", environment_steps=40_000, config=SMALL)
print(f"{training.folder}: mean return {training.final_return:.0f}")

# %% [markdown]
# The policy, in an episode of its own.

# %%
policy = hksl.load(training.folder)
env = FrameStackObservation(pendulum(), policy.frame_stack)
observation, _ = env.reset(seed=0)
total = 0.0
while True:
    observation, reward, terminated, truncated, _ = env.step(policy.act(observation))
    total += float(reward)
    if terminated or truncated:
        break
print(f"return of one episode: {total:.0f}")
