# %% [markdown] tags=["badge"]
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/OWNER/dronecombat-jax/blob/main/experiments/notebooks/2_train_ippo.ipynb)

# %% [markdown]
# # 2. Train with IPPO and watch
#
# Two independent PPO learners, an attacker and a defender, learn from nothing but the game. Then: their learning
# curves, a replay of what they learnt, and the same start flown along the training.

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
# ## Train
#
# The `smoke` preset proves in seconds that everything runs; its pilots learn nothing. `colab` trains eight seeds at
# once on a GPU. On two cores, `dronecombat train` (preset `duel`) takes about six minutes in a terminal.
#
# **After a disconnect, run all cells again.** A run is known by its name, every chunk is saved, and the same call
# goes on from the last one. On Colab a lost machine takes its files along: mount a drive and change to it first
# (`google.colab.drive.mount`, `os.chdir`).

# %%
PRESET = {"smoke": "smoke", "full": "colab"}[SIZES]
NAME = f"notebook-ippo-{SIZES}"

run = dc.train(PRESET, {"run.name": NAME, "run.video": False})
print(run)

# %% [markdown]
# The same call once more has nothing to do, and `train.total_steps` may be raised to go on:

# %%
assert dc.train(PRESET, {"run.name": NAME, "run.video": False}) == run

# %% [markdown]
# ## Learning curves
#
# `runs/NAME/figures/learning.png` was drawn at the end of the training. The defender is blue, the attacker orange.
# Blue areas of the first panel are good for the defender, orange ones for the attacker, grey ones are ties.

# %%
from IPython.display import Image, display

display(Image(str(run / "figures" / "learning.png"), width=1100))

# %% [markdown]
# They are drawn from `metrics.jsonl`, one line for each iteration and seed. Your own figure is a few lines:

# %%
import json

import matplotlib.pyplot as plt
import numpy as np

rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
first = [row for row in rows if row["seed"] == rows[0]["seed"]]
steps = np.array([row["steps"] for row in first])
figure, axes = plt.subplots(figsize=(8, 3.5))
for key, colour in (("win/defender", "#0072B2"), ("win/attacker", "#D55E00"), ("win/draw", "grey")):
    shares = np.array([row[key] for row in first], dtype=float)  # null, where no fight ended: NaN
    axes.plot(steps, shares, color=colour, label=key)
axes.set(xlabel="environment steps", ylabel="share of ended fights", ylim=(0, 1))
axes.legend()
plt.show()

# %% [markdown]
# ## Who wins?
#
# Shares with 95 % intervals, of the newest policies flying their mean actions:

# %%
evaluation = json.loads((run / "evaluation.json").read_text())
for seed in evaluation:
    for side, (share, low, high) in seed["win"].items():
        print(f"seed {seed['seed']}  {side:<8} {share:.2f}  [{low:.2f}, {high:.2f}]")

# %% [markdown]
# ## Watch them
#
# A run, as far as it is trained; then one start, flown by its policies of 0 %, 10 %, ... 100 % of the training.
# `docs/replay.md` lists keys and gestures.

# %%
dc.show(run, fights={"smoke": 2, "full": 9}[SIZES])

# %%
evolution = dc.show(run, evolution=True)
evolution

# %% [markdown]
# ## Against a scripted pilot
#
# Any side of the replay may be somebody else: a chunk number, a scripted pilot, another run.

# %%
dc.show(run, defender="hover_guard", fights=1)

# %% [markdown]
# ## From Python
#
# `load_run` gives settings, environment and state; chunk 0 is untrained. A policy is a small network:

# %%
from dronecombat_jax.runs.evaluation import policies

saved = dc.load_run(run)
defender, attacker = policies(saved, 0)
print("after", saved.iteration, "iterations:", [layer.shape for layer in attacker.network.weights])

# %% [markdown]
# Next: [3. Self-play](3_self_play.ipynb).

# %%
# What this notebook claims, checked.
config = saved.config
iterations = config.num_chunks * config.train.chunk_iterations
assert saved.iteration == iterations and len(rows) == iterations * config.train.num_seeds
assert steps[-1] == iterations * config.steps_per_iteration
for seed in evaluation:
    assert abs(sum(share for share, _, _ in seed["win"].values()) - 1.0) < 1e-6
assert len(evolution.fights) == min(config.num_chunks, 10) + 1  # untrained, then every tenth
starts = [np.asarray(fight.trajectory.qpos)[0] for fight in evolution.fights]
assert all(np.array_equal(starts[0], start) for start in starts)
weights = lambda chunk: dc.load_run(run, chunk).state.learners.parameters.policy.weights[0]
assert not np.allclose(weights(0), weights(None)), "training must change the policies"
if SIZES == "full":
    hits = [seed["win"]["attacker"][0] + seed["win"]["defender"][0] for seed in evaluation]
    assert np.mean(hits) > 0.5, "most fights must be decided after this training"
print("all of this notebook's numbers hold")
