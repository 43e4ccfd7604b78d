# %% [markdown] tags=["badge"]
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/OWNER/dronecombat-jax/blob/main/experiments/notebooks/1_first_fight.ipynb)

# %% [markdown]
# # 1. A first fight
#
# Two Crazyflies: the attacker flies to a target, the defender flies to the attacker. No training yet: two policies
# that come with the package fly, trained for twenty million steps. You see a fight within a minute.

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
# ## Watch
#
# `show` flies fights and returns a replay: click a fight, then drag, scroll, press space. It needs no OpenGL and no
# server. The two names are all that changes for other pilots: a run, a policy file (`attacker.safetensors`),
# another policy of the package (`dronecombat pilots` lists them), or a scripted pilot such as `scripted:weave`.

# %%
DEFENDER, ATTACKER = "pilots:sippo-defender", "pilots:sippo-attacker"
FIGHTS = {"smoke": 4, "full": 9}[SIZES]

replay = dc.show(DEFENDER, ATTACKER, fights=FIGHTS)
replay

# %% [markdown]
# Kept as one file, it opens in any browser, without a network:

# %%
page = replay.save("first_fight.html")
print(f"{page}: {page.stat().st_size / 1e6:.2f} MB")

# %% [markdown]
# ## The scene
#
# MuJoCo's description is in `mjcf/`. A drone is one rigid body: thrust along its z axis and three moments move it
# (eq. 7 and 8 of the paper), 50 times a second.

# %%
import numpy as np

config = dc.load_config("duel")
combat = dc.Combat(config)
mass, weight = combat.scene.mass[0], combat.scene.weight[0]  # of the defender; both are alike
print(f"mass {mass * 1e3:.1f} g, weight {weight:.3f} N")
print(f"full thrust {config.sim.thrust_to_weight * weight:.3f} N")
print(f"a control step takes {config.control_dt} s; a fight {config.game.episode_steps} steps")

# %% [markdown]
# ## One fight by hand
#
# `reset` and `step` are pure functions of one fight; `jax.vmap` makes a thousand of them. Here the attacker pitches
# forward a little, and the defender holds its thrust at hover.

# %%
import jax.numpy as jnp

HOVER = 2.0 / config.sim.thrust_to_weight - 1.0  # the action whose thrust is the weight

state = jax.jit(combat.reset)(jax.random.key(0))
step = jax.jit(combat.step)
action = jnp.zeros((2, 4)).at[:, 0].set(HOVER)
flown = []
for number in range(50):
    pitch = 0.002 if number < 5 else 0.0
    state, output = step(state, action.at[1, 2].set(pitch))
    flown.append(np.asarray(state.qpos).reshape(2, 7)[:, :3])
flown = np.array(flown)  # [T, A, 3] m
for role, name in enumerate(("defender", "attacker")):
    print(f"the {name} went", (flown[-1, role] - flown[0, role]).round(2), "m")
print("reward of the last step:", np.asarray(output.reward).round(3))

# %% [markdown]
# ## The replay's numbers
#
# What was shown is plain arrays, too: `qpos` [T, 14], actions [T, 2, 4], the cause that ended each fight.

# %%
import matplotlib.pyplot as plt

from dronecombat_jax.types import Cause

fight = replay.fights[0].trajectory
figure, (above, thrust) = plt.subplots(1, 2, figsize=(11, 4))
for role, (name, colour) in enumerate((("defender", "#0072B2"), ("attacker", "#D55E00"))):
    path = np.asarray(fight.qpos)[:, 7 * role : 7 * role + 3]
    above.plot(path[:, 0], path[:, 1], color=colour, label=name)
    above.plot(*path[0, :2], "o", color=colour)
    thrust.plot(fight.time, (np.asarray(fight.action)[:, role, 0] + 1) / 2, color=colour)
above.plot(*np.asarray(fight.target)[:2], "*", color="green", markersize=14, label="target")
above.set(xlabel="x, m", ylabel="y, m", title="from above", aspect="equal")
above.legend()
thrust.set(xlabel="s", ylabel="share of full thrust", title=Cause(fight.cause).name.lower())
plt.show()

# %% [markdown]
# ## Who wins?
#
# One fight says little. Every scripted attacker against every scripted defender:

# %%
EPISODES = {"smoke": 4, "full": 64}[SIZES]

from dronecombat_jax.analysis.result import win_rate

result = dc.tournament(["scripted:all"], episodes=EPISODES, name="first-fight")
share = win_rate(result)  # [D, A] of fights that the defender wins
width = max(len(entrant.label) for entrant in result.defenders)
print(" " * width, *(f"{entrant.label:>10}" for entrant in result.attackers))
for entrant, row in zip(result.defenders, share, strict=True):
    print(f"{entrant.label:<{width}}", *(f"{value:10.2f}" for value in row))

# %% [markdown]
# Next: [2. Train with IPPO](2_train_ippo.ipynb).

# %%
# What this notebook claims, checked.
labels = [entrant.label for entrant in result.defenders]
guarded = share[labels.index("proportional_navigation")]
hovering = share[labels.index("hover")]
assert np.all(result.played) and result.cause.shape[2] == EPISODES
assert guarded.mean() > hovering.mean(), "navigation must stop more attackers than standing still"
assert len(replay.fights) == FIGHTS and page.stat().st_size < 1.5e6
assert flown[-1, 1, 0] - flown[0, 1, 0] > 0.05, "a positive pitch must carry a drone along x"
assert abs(flown[-1, 0, :] - flown[0, 0, :]).max() < 0.01, "hover thrust must hold a level drone"
print("all of this notebook's numbers hold")
