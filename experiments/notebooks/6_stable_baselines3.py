# %% [markdown] tags=["badge"]
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/OWNER/dronecombat-jax/blob/main/experiments/notebooks/6_stable_baselines3.ipynb)

# %% [markdown]
# # 6. Stable-Baselines3 through the Gymnasium view
#
# Another library's learner flies one side. The fights of the other side, physics and rules stay in one jitted program;
# the learner sees a vector environment. What it has learnt becomes a policy file, which replays, fights and is rated
# like ours.

# %% tags=["setup"]
# Installs the package with the versions that were tested together, unless it is here already.
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

REPOSITORY = "OWNER/dronecombat-jax"  # a placeholder until the project has a public address


def install() -> None:
    """From the checkout around this notebook, or from REPOSITORY; versions of constraints.txt."""
    folders = [Path.cwd(), *Path.cwd().parents]
    checkouts = [path for path in folders if (path / "dronecombat_jax/__init__.py").is_file()]
    source = checkouts[0] if checkouts else Path("dronecombat-jax").absolute()
    if not source.is_dir():
        if REPOSITORY.startswith("OWNER/"):
            raise RuntimeError("REPOSITORY is a placeholder: open this notebook in a checkout")
        address = f"https://github.com/{REPOSITORY}"
        subprocess.run(["git", "clone", "--depth", "1", address, str(source)], check=True)
    package = f"{source}[cuda12]" if shutil.which("nvidia-smi") else str(source)
    command = [sys.executable, "-m", "pip", "install", "--quiet"]
    subprocess.run([*command, "-c", str(source / "constraints.txt"), package], check=True)
    importlib.invalidate_caches()
    if {"jax", "numpy"} & sys.modules.keys():  # of other versions than those installed now
        raise RuntimeError("installed: restart the session, then run all cells")


if importlib.util.find_spec("dronecombat_jax") is None:
    install()
import dronecombat_jax as dc

dc.prepare()  # before JAX is imported; refuses versions of it that hang or compute wrong numbers
import jax

from dronecombat_jax.machine.backend import banner

# "full" wants a GPU. "smoke" runs anywhere in about a minute: everything works, nothing is learnt.
SIZES = "smoke" if jax.default_backend() == "cpu" else "full"
if os.environ.get("DRONECOMBAT_NOTEBOOK") == "smoke":
    SIZES = "smoke"
print(*banner(), f"sizes     {SIZES}", sep="\n")

# %% [markdown]
# Stable-Baselines3 brings PyTorch along: some gigabytes where it is not installed yet.

# %%
if importlib.util.find_spec("stable_baselines3") is None:
    packages = ["gymnasium>=1.1", "stable-baselines3>=2.7"]
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", *packages], check=True)
    importlib.invalidate_caches()

# %% [markdown]
# ## Fights as a vector environment
#
# The attacker learns against a scripted defender. In place of `scripted:hover` may stand a policy file, a shipped
# pilot such as `pilots:ippo-defender`, or a list of them: then each fight draws one.

# %%
from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
from dronecombat_jax.adapters.sb3_env import to_sb3

FIGHTS, STEPS = {"smoke": (8, 2_000), "full": (256, 4_000_000)}[SIZES]
config = dc.load_config("duel")
fights = CombatVectorEnv(dc.Combat(config), "attacker", "scripted:hover", FIGHTS, "SAME_STEP")
print(fights.single_observation_space, fights.single_action_space, fights.metadata, sep="\n")

# %% [markdown]
# A step of all fights: observations [N, 35], rewards [N], ends [N].

# %%
import numpy as np

observation, _ = fights.reset(seed=0)
for _ in range(20):
    observation, reward, terminated, truncated, infos = fights.step(fights.action_space.sample())
print(observation.shape, reward.shape, "ended:", int((terminated | truncated).sum()))

# %% [markdown]
# ## Their PPO
#
# Two networks of 256 and 128 with ELU, as the paper's (preset `duel` has 64 and 64); actions near hover and little
# noise at first, as preset `duel` begins.

# %%
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

torch.manual_seed(0)
model = PPO(
    "MlpPolicy",
    VecMonitor(to_sb3(fights)),
    n_steps={"smoke": 32, "full": 24}[SIZES],
    batch_size={"smoke": 64, "full": 1536}[SIZES],
    n_epochs=5,
    learning_rate=5e-4,
    gamma=0.99,
    seed=0,
    device="cpu",
    policy_kwargs={
        "net_arch": {"pi": [256, 128], "vf": [256, 128]},
        "activation_fn": torch.nn.ELU,
        "log_std_init": -0.5,
    },
)
model.learn(STEPS, progress_bar=False)
print(model.num_timesteps, "environment steps")

# %% [markdown]
# ## As a policy file
#
# `Linear` keeps its weights [out, in]; a policy file has [in, out].

# %%
from dronecombat_jax.policies.foreign import save_network

layers = [layer for layer in model.policy.mlp_extractor.policy_net if hasattr(layer, "weight")]
layers.append(model.policy.action_net)
numbers = lambda tensor: tensor.detach().numpy()
path = save_network(
    "sb3-attacker.safetensors",
    "attacker",
    config,
    [numbers(layer.weight).T for layer in layers],
    [numbers(layer.bias) for layer in layers],
    log_std=numbers(model.policy.log_std),
    name="stable-baselines3",
    steps=model.num_timesteps,
    force=True,
)
print(path, path.stat().st_size, "bytes")

# %% [markdown]
# ## Watch it
#
# Against the defender that it has met, and against one that it has never met:

# %%
dc.show(attacker=str(path), defender="hover", fights=1)

# %%
unknown = dc.show(attacker=str(path), defender="pilots:ippo-defender", fights=2)
unknown

# %% [markdown]
# How good is it? `dronecombat rate sb3-attacker.safetensors` flies it against all pilots that come with the package.
# The checker that found our own faults takes any batched environment: `dronecombat_jax.adapters.check(fights)`.

# %%
# What this notebook claims, checked.
from dronecombat_jax.policies.numpy_policy import NumpyPolicy

seen = observation[0]
mean = model.policy.get_distribution(torch.as_tensor(seen[None])).distribution.mean
assert np.allclose(NumpyPolicy(path)(seen), numbers(mean)[0], atol=1e-5), "the file flies the same"
assert model.num_timesteps >= STEPS and observation.shape == (FIGHTS, 35)
assert len(unknown.fights) == 2
if SIZES == "full":
    reached = np.mean(model.ep_success_buffer)  # of the last hundred fights
    assert reached > 0.5, "most fights must end at the target after this training"
print("all of this notebook's numbers hold")
