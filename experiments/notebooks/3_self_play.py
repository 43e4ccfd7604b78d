# %% [markdown] tags=["badge"]
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/OWNER/dronecombat-jax/blob/main/experiments/notebooks/3_self_play.ipynb)

# %% [markdown]
# # 3. Self-play and its pool
#
# A defender that only ever meets today's attacker may forget yesterday's. S-IPPO, the paper's self-play, cuts training
# into chunks; in some of them the defender meets a frozen past attacker, drawn from the pool of all saved ones.

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
# IPPO is the same program with probability 0. The paper's probability is 0.2; at smoke size, with six chunks, a higher
# one shows something. Interrupted, the same cell goes on.

# %%
SIZE = {
    "smoke": ("smoke", {"train.total_steps": 18_432, "selfplay.probability": 0.8}),
    "full": ("colab", {"selfplay.probability": 0.2}),
}
preset, changes = SIZE[SIZES]
changes |= {"run.name": f"notebook-sippo-{SIZES}", "run.video": False}

run = dc.train(preset, changes)
config = dc.load_config(preset, changes)
print(f"{run}: {config.num_chunks} chunks of {config.train.chunk_iterations} iterations")

# %% [markdown]
# ## Who was met
#
# `chunks.jsonl` has one line for each chunk and seed. `frozen` is the side that was played by its past, `opponent` the
# slot it was drawn from: slot 0 is the untrained attacker, slot k the attacker as it was after k chunks.

# %%
import json

import numpy as np

lines = [json.loads(line) for line in (run / "chunks.jsonl").read_text().splitlines()]
chunks = [line for line in lines if line["seed"] == config.train.seed]
print("chunk  who was met            defender wins   length of a fight")
for line in chunks:
    who = "today's attacker" if line["frozen"] is None else f"attacker of slot {line['opponent']}"
    wins, length = line["win/defender"], line["episode_steps"]
    numbers = ["   none ended" if value is None else f"{value:13.2f}" for value in (wins, length)]
    print(f"{line['chunk']:5}  {who:<20}", *numbers)

# %% [markdown]
# ## How the defender fares against its past opponents
#
# The pool keeps a record of wins against each member, in which old fights fade (`selfplay.memory`). Rows are chunks,
# columns are slots; white was not met of late.

# %%
import matplotlib.pyplot as plt

table = np.full((len(chunks), len(chunks)), np.nan)
for row, line in enumerate(chunks):
    for slot, rate in zip(line["members/attacker"], line["win_rate/attacker"], strict=True):
        table[row, slot] = rate
figure, axes = plt.subplots(figsize=(6, 5))
image = axes.imshow(table, vmin=0, vmax=1, cmap="RdBu", origin="lower", aspect="auto")
axes.set(xlabel="slot of the past attacker", ylabel="chunk", title="share of wins so far")
axes.set_yticks(range(len(chunks)), [line["chunk"] for line in chunks])
figure.colorbar(image)
plt.show()

# %% [markdown]
# ## Samplers
#
# Which member is drawn is a small pure function: it gives each slot a weight. Here is what the five that come with the
# package do with ten members, of which the learner beats the older ones:

# %%
import jax.numpy as jnp

from dronecombat_jax.selfplay.samplers import SAMPLERS, Members

members = Members(
    slot=jnp.arange(10), filled=jnp.asarray(10), win_rate=jnp.linspace(0.95, 0.05, 10)
)
figure, axes = plt.subplots(figsize=(8, 3.5))
drawn = {}
for name, sampler in SAMPLERS.items():
    weight = np.asarray(sampler(members, config.selfplay))
    drawn[name] = weight / weight.sum()
    axes.plot(drawn[name], marker="o", label=name)
axes.set(xlabel="slot (0: untrained)", ylabel="chance to be drawn")
axes.legend()
plt.show()

# %% [markdown]
# One of your own is MODULE:NAME: [5. Your own parts](5_your_own.ipynb).
#
# ## Watch today's defender against an early attacker

# %%
dc.show(run, attacker=0, fights=1)

# %% [markdown]
# Whether self-play helps is a question for many seeds: `dronecombat compare runs/ippo* runs/sippo* --by method`.
# Next: [4. Tournament](4_tournament.ipynb).

# %%
# What this notebook claims, checked.
assert [line["chunk"] for line in chunks] == list(range(1, config.num_chunks + 1))
assert chunks[0]["frozen"] is None, "the first chunk has no past to meet"
frozen = [line for line in chunks if line["frozen"] is not None]
assert {line["frozen"] for line in frozen} == {"attacker"}, "the defender meets past attackers"
assert all(0 <= line["opponent"] < line["chunk"] for line in frozen), "nobody meets the future"
assert all(line["learning_rate/attacker"] is None for line in frozen), "the frozen do not learn"
for name, chance in drawn.items():
    assert abs(chance.sum() - 1.0) < 1e-5 and chance.min() >= 0.0, name
assert np.ptp(drawn["uniform"]) < 1e-6 and drawn["latest"].argmax() == 9
assert drawn["pfsp_hard"].argmax() == 9 and drawn["pfsp_variance"].argmax() in (4, 5)
print("all of this notebook's numbers hold")
