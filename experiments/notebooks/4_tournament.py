# %% [markdown] tags=["badge"]
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/OWNER/dronecombat-jax/blob/main/experiments/notebooks/4_tournament.ipynb)

# %% [markdown]
# # 4. Tournament, ratings, the paper's figures
#
# Every saved attacker meets every saved defender, of IPPO and of S-IPPO, and the scripted pilots beside them. All
# ratings are functions of the outcomes, so they are computed again and again without another fight.

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
# ## Two methods
#
# The runs of notebooks [2](2_train_ippo.ipynb) and [3](3_self_play.ipynb); where they are missing they are trained now.
# Interrupted, the same cell goes on. At full size each has eight seeds, at smoke size one.

# %%
PRESET = {"smoke": "smoke", "full": "colab"}[SIZES]
SELF_PLAY = {
    "smoke": {"train.total_steps": 18_432, "selfplay.probability": 0.8},
    "full": {"selfplay.probability": 0.2},
}[SIZES]
runs = []
for method, changes in (("ippo", {}), ("sippo", SELF_PLAY)):
    named = {"run.name": f"notebook-{method}-{SIZES}", "run.video": False}
    runs.append(dc.train(PRESET, changes | named))

# %% [markdown]
# ## Fly it
#
# Fight e of a pair starts alike for all pairs. It is saved as it goes: stopped, the same call goes on, and with one
# entrant more only the new fights are flown.

# %%
EPISODES = {"smoke": 2, "full": 5}[SIZES]
EVERY = {"smoke": 1, "full": 4}[SIZES]  # of a run every n-th chunk, and the last
NAME = f"notebook-{SIZES}"

result = dc.tournament([*runs, "scripted:all"], episodes=EPISODES, every=EVERY, name=NAME)
print(result.counts.shape, "defenders, attackers, causes;", int(result.counts.sum()), "fights")

# %% [markdown]
# ## Ratings
#
# Bradley-Terry ratings, in Elo points: only differences within this tournament mean anything. Elo as the paper prints
# it (eq. 3, 4) depends on the order of the fights; `elo_ratings` takes the mean over many orders and tells the spread.

# %%
import numpy as np

from dronecombat_jax.analysis.bradley_terry import bradley_terry
from dronecombat_jax.analysis.elo import elo_ratings
from dronecombat_jax.analysis.result import scores

wins, ties, losses = scores(result)
ratings = bradley_terry(wins, losses, ties)
elo = elo_ratings(result, orders={"smoke": 4, "full": 32}[SIZES])
entrants = [*result.defenders, *result.attackers]
sequential = np.concatenate([elo.defender, elo.attacker])
print(f"{'':34} Bradley-Terry      Elo")
for index in np.argsort(-ratings.rating)[:12]:
    interval = f"{ratings.rating[index]:7.0f} +- {ratings.error[index]:4.0f}"
    print(f"{entrants[index].label:<34} {interval}  {sequential[index]:7.0f}")

# %% [markdown]
# ## The paper's figures
#
# Elo over training (figures 4 and 5), win rates of ten defenders against all attackers (6 and 7), their variance over
# seeds (8 and 9; one seed has none). `dronecombat report NAME` writes them all, with tables, as one page; so does:

# %%
from IPython.display import Image, display

from dronecombat_jax.report.tournament_report import report

report(f"tournaments/{NAME}")
folder = Path("tournaments") / NAME / "report"
for figure in ("elo_over_time", "win_rate_map", "variance_map"):
    display(Image(str(folder / "figures" / f"{figure}.png"), width=900))

# %% [markdown]
# ## Watch a pair
#
# The last S-IPPO defender against the last IPPO attacker:

# %%
dc.show(runs[1], attacker=runs[0], fights=1)

# %% [markdown]
# Next: [5. Your own parts](5_your_own.ipynb).

# %%
# What this notebook claims, checked.
defenders, attackers = result.played.shape
assert result.played.all() and result.counts.sum() == defenders * attackers * EPISODES
assert np.array_equal(wins + ties + losses, np.full(result.played.shape, EPISODES))
lineages = {entrant.lineage for entrant in entrants if entrant.lineage}
seeds = dc.load_config(PRESET).train.num_seeds
assert len(lineages) == 2 * seeds, lineages
assert abs(np.mean(ratings.rating) - 1500.0) < 1.0 and np.isfinite(ratings.error).all()
assert abs(sequential.mean() - 1500.0) < 1e-6, "a fight moves both by as much"
assert (folder / "report.html").is_file()
print("all of this notebook's numbers hold")
