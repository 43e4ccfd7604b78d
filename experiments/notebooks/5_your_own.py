# %% [markdown] tags=["badge"]
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/OWNER/dronecombat-jax/blob/main/experiments/notebooks/5_your_own.ipynb)

# %% [markdown]
# # 5. Your own reward, sampler, observation, algorithm
#
# Each is a small pure function in a file of your own, named MODULE:NAME. Nothing in the package changes, and the name
# is stored with the run: it goes on, fights and replays like any other as long as the file is there.

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
# ## The file
#
# Written from here, so that the notebook has everything; with a file beside it you would just edit that. It runs
# inside the jitted program: no `if` on arrays. After an edit restart the kernel: Python imports a module once.

# %%
PARTS = '''
"""My parts of the duel."""

import jax
import jax.numpy as jnp
from flax import struct

from dronecombat_jax.combat.games import DUEL
from dronecombat_jax.combat.observe import Observation
from dronecombat_jax.learn.algorithms import Algorithm
from dronecombat_jax.learn.networks import init_parameters
from dronecombat_jax.learn.normalize import init_scaler
from dronecombat_jax.sim.rotation import rotate_inverse
from dronecombat_jax.types import Policy, UpdateMetrics


def careful(config, drones, target, events, down, cause):
    """The reward terms of the duel, each [A], but a crash costs ten times as much."""
    terms = DUEL.reward(config, drones, target, events, down, cause)
    return terms._replace(crash=10.0 * terms.crash)


CAREFUL = DUEL._replace(reward=careful)


def oldest_half(members, selfplay):
    """Weights [K] of the pool's members: alike among the older half."""
    return (members.slot <= (members.filled - 1) // 2).astype(jnp.float32)


def bearings(drones, target):
    """What a drone sees, [A, 15], in its own frame: velocity, rate, up, and two directions."""
    unit = lambda vector: vector / (jnp.linalg.norm(vector, axis=-1, keepdims=True) + 1e-6)
    into = lambda vector: rotate_inverse(drones.quaternion, vector)
    other = jnp.flip(drones.position, axis=0) - drones.position
    up = jnp.broadcast_to(jnp.asarray([0.0, 0.0, 1.0]), drones.position.shape)
    seen = [into(drones.velocity), drones.rate, into(up), into(unit(other))]
    return jnp.concatenate([*seen, into(unit(target - drones.position))], axis=-1)


BEARINGS = Observation(
    (("v_self", 3), ("w_self", 3), ("up", 3), ("to_other", 3), ("to_target", 3)), bearings
)


class Searcher(struct.PyTreeNode):
    """Random search: the best policy so far, the one on trial, what the best has earned."""

    best: Policy
    trial: Policy
    earned: jax.Array


def init(key, learn, observation_size):
    """An untrained policy; nothing is earned yet."""
    parameters = init_parameters(key, learn, observation_size)
    policy = Policy(parameters.policy, parameters.log_std, init_scaler((observation_size,)))
    return Searcher(best=policy, trial=policy, earned=jnp.asarray(-1e9))


def learn(learn, searcher, rollout, side, key):
    """Keep the policy on trial if it earned more, then try a new change."""
    earned = jnp.mean(rollout.reward[:, :, side])
    pick = lambda new, old: jnp.where(earned > searcher.earned, new, old)
    best = jax.tree.map(pick, searcher.trial, searcher.best)
    leaves, structure = jax.tree.flatten(best.network)
    keys = jax.random.split(key, len(leaves))
    moved = [x + 0.02 * jax.random.normal(k, x.shape) for k, x in zip(keys, leaves)]
    trial = best.replace(network=jax.tree.unflatten(structure, moved))
    metrics = dict.fromkeys(UpdateMetrics._fields, jnp.full((), jnp.nan))
    metrics["skipped"] = jnp.zeros((), jnp.int32)
    earned = jnp.maximum(earned, searcher.earned)
    return Searcher(best=best, trial=trial, earned=earned), UpdateMetrics(**metrics)


RANDOM_SEARCH = Algorithm(
    init=init,
    learn=learn,
    policy=lambda searcher: searcher.trial,
    adopt=lambda searcher, policy: searcher.replace(best=policy, trial=policy),
)
'''
Path("my_parts.py").write_text(PARTS)
sys.path.insert(0, str(Path.cwd()))  # where a command runs is looked in by itself
import my_parts

# %% [markdown]
# ## Check the parts before you train
#
# They are plain functions: call them. A minute here saves an hour of a run that learns the wrong thing.

# %%
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.selfplay.samplers import Members
from dronecombat_jax.types import Drones

pool = Members(slot=jnp.arange(6), filled=jnp.asarray(4), win_rate=jnp.full(6, 0.5))
weights = np.asarray(my_parts.oldest_half(pool, None))
print("sampler:", weights)

level = jnp.tile(jnp.asarray([1.0, 0.0, 0.0, 0.0]), (2, 1))
still = jnp.zeros((2, 3))
drones = Drones(jnp.asarray([[0.0, 5.0, 1.0], [0.0, 0.0, 1.0]]), level, still, still)
seen = np.asarray(my_parts.bearings(drones, jnp.asarray([5.0, 5.0, 1.0])))
print("from the attacker, the defender is at", seen[1, 9:12].round(2))
print("                   and the target at", seen[1, 12:].round(2))

# %% [markdown]
# ## Train with reward, sampler and observation

# %%
PRESET = {"smoke": "smoke", "full": "colab"}[SIZES]
changes = {
    "run.name": f"notebook-own-{SIZES}",
    "run.video": False,
    "game.scenario": "my_parts:CAREFUL",
    "game.observation": "my_parts:BEARINGS",
    "selfplay.probability": {"smoke": 0.9, "full": 0.2}[SIZES],
    "selfplay.sampler": "my_parts:oldest_half",
}
mine = dc.train(PRESET, changes)

# %% [markdown]
# On the command line, in the folder of `my_parts.py`, the same is
#
#     dronecombat train --preset smoke --game.scenario my_parts:CAREFUL --game.observation my_parts:BEARINGS \
#         --selfplay.probability 0.9 --selfplay.sampler my_parts:oldest_half

# %%
dc.show(mine, fights=1)

# %% [markdown]
# ## Train with a learner of your own
#
# What a learner holds is its own business; self-play, checkpoints and tournaments see the policy that it flies. This
# one is a plain random search: it needs no gradient, and it shows the interface. Do not expect much of it.

# %%
searched = dc.train(
    PRESET,
    {
        "run.name": f"notebook-search-{SIZES}",
        "run.video": False,
        "run.replay": False,
        "learn.algorithm": "my_parts:RANDOM_SEARCH",
    },
)

# %% [markdown]
# ## And a mistake
#
# What is not there is one line:

# %%
mistake = ""
try:
    dc.train(PRESET, {"run.name": "notebook-mistake", "game.observation": "my_parts:BEARING"})
except dc.UserError as error:
    mistake = str(error)
print(mistake)

# %% [markdown]
# More: `examples/` has each part as a program; `CONTRIBUTING.md` says how to add one to the package.

# %% [markdown]
# Next: [6. Stable-Baselines3](6_stable_baselines3.ipynb).

# %%
# What this notebook claims, checked.
import json

assert weights.tolist() == [1, 1, 0, 0, 0, 0]  # filled 4: slots 0 and 1 are the older half
assert np.allclose(seen[1, 9:12], [0, 1, 0], atol=1e-5)  # the defender is 5 m along y
assert np.allclose(seen[1, 12:], [np.sqrt(0.5), np.sqrt(0.5), 0], atol=1e-5)
saved = dc.load_run(mine)
assert saved.combat.observation.size == 15
assert saved.state.learners.parameters.policy.weights[0].shape[-2] == 15
assert saved.config.selfplay.sampler == "my_parts:oldest_half"
rows = [json.loads(line) for line in (mine / "metrics.jsonl").read_text().splitlines()]
crash = min(row["reward/attacker/crash"] for row in rows)
assert crash < 0.0, "in so many fights of beginners some attacker crashes, and pays"
assert dc.load_run(searched).config.learn.algorithm == "my_parts:RANDOM_SEARCH"
assert "my_parts has no BEARING" in mistake
print("all of this notebook's numbers hold")
