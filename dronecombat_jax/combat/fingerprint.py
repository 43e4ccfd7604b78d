"""Which game a policy knows: the settings, scene and observation that its actions depend on.

And their sha256. What does not live here: who compares them (`policies.file`, tournaments). Rewards
and learning are no part of the game that a trained policy meets.
"""

import hashlib
import json
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from dronecombat_jax.combat.observe import OBSERVATIONS, layout_of, observation_of
from dronecombat_jax.config.fields import (
    Config,
    DroneConfig,
    GameConfig,
    RandomiseConfig,
    SensorConfig,
)
from dronecombat_jax.config.opponents import SIDES
from dronecombat_jax.config.schema import flatten
from dronecombat_jax.config.settings import SCHEMA

if TYPE_CHECKING:
    from dronecombat_jax.sim.scene import Scene

# Raise it where physics, rules or observation change while the settings stay as they are.
ENVIRONMENT_VERSION = 1
# Settings that came later. With these values the game is what it was without them, so they are left
# out, and the digest stays the same.
_LATER = {
    "game.defenders": 1,
    "game.attackers": 1,
    "game.team_spacing": 0.5,
    "game.striker_down": False,
    "game.spawn_spread": 0.0,
    "game.defender_spread": 0.0,
    "game.defender_setback": 0.0,
    "game.nearest_k": 2,
    "sim.actuation": "wrench",
    "sim.drag": False,
    "sim.gust_speed": 0.0,
    "sim.gust_time": 1.0,
    "sim.battery": 0.0,
    **{f"{side}.{item.name}": item.default for side in SIDES for item in fields(DroneConfig)},
    **{f"randomise.{item.name}": item.default for item in fields(RandomiseConfig)},
    **{f"sensor.{item.name}": item.default for item in fields(SensorConfig)},
}
# The clock of a training run's first fights: no fight between trained policies begins with it.
_TRAINING_ONLY = ("game.random_clock",)
# Where a scene's file lies. What it says is in the keys of `scene.`: moved, it is the same game.
_PLACES = ("sim.mjcf",)
SCENE, ROTORS = "scene.", "rotors."
# Sections whose settings a policy meets.
MET = ("sim.", "game.", "defender.", "attacker.", "randomise.", "sensor.")


def environment(config: Config, scene: "Scene | None" = None) -> dict[str, Any]:
    """What a trained policy meets, as plain JSON by dotted key.

    Version, observation, the settings of the sections in `MET`, as `rotors.KEY` the numbers of
    rotors and drag where they are flown, and as `scene.KEY` each number of the scene that is not
    the package's own. `scene`: as it was loaded for `config`; without it the MJCF is read anew.
    Raises UserError where it cannot be.
    """
    from dronecombat_jax.sim.bodies import named  # MuJoCo, which a policy file can do without
    from dronecombat_jax.sim.flown import differences
    from dronecombat_jax.sim.rotors import described, flies_rotors
    from dronecombat_jax.sim.source import flown_of

    body = named(config.sim.body)
    flown, rotors = (scene.flown, scene.rotors) if scene else flown_of(config.sim)
    values = flatten(config) | {"sim.body": body}
    met = [
        key
        for key in SCHEMA
        if key.startswith(MET)
        and key not in (*_TRAINING_ONLY, *_PLACES)
        and values[key] != _LATER.get(key)
    ]
    seen = [list(field) for field in observation_of(config).fields]
    return {
        "version": ENVIRONMENT_VERSION,
        "observation_fields": seen,
        **{key: SCHEMA[key].normal(values[key]) for key in met},  # 1 and 1.0 are the same setting
        **(described(rotors) if rotors and flies_rotors(config.sim) else {}),
        **differences(flown, body),
    }


def canonical(environment: dict[str, Any]) -> str:
    """The one spelling of an environment as JSON: sorted keys, no spaces."""
    return json.dumps(environment, sort_keys=True, separators=(",", ":"), allow_nan=False)


def environment_digest(config: Config) -> str:
    """sha256 in hex of the canonical spelling: equal where policies may fight each other."""
    return digest_of(environment(config))


def digest_of(environment: dict[str, Any]) -> str:
    """sha256 in hex of an environment."""
    return hashlib.sha256(canonical(environment).encode()).hexdigest()


def environment_diff(saved: dict[str, Any], here: dict[str, Any]) -> list[str]:
    """One line for each part in which two environments differ; foreign values are spelt as JSON."""
    spelt = lambda side, key: json.dumps(side[key]) if key in side else _absent(key)
    return [
        f"{key} is {spelt(saved, key)} there, {spelt(here, key)} here"
        for key in sorted(saved.keys() | here.keys())
        if key not in saved or key not in here or saved[key] != here[key]
    ]


def game_diff(saved: dict[str, Any], here: dict[str, Any], game: GameConfig) -> list[str]:
    """`environment_diff` of a policy that is shown what it saw in its training.

    Another layout of `OBSERVATIONS` than the game's is no difference, if it has the same parts in
    `game`, the game of `here`.
    """
    name = own_view(saved, game)
    if name:
        seen = [list(field) for field in layout_of(name, game).fields]
        here = here | {"game.observation": name, "observation_fields": seen}
    return environment_diff(saved, here)


def own_view(saved: dict[str, Any] | None, game: GameConfig) -> str:
    """The layout of `OBSERVATIONS` that a policy of the environment `saved` is to be shown in `game`; "":
    what the game shows. `saved` None: a pilot that knows any game.
    """
    name = None if saved is None else saved.get("game.observation")
    known = isinstance(name, str) and name in OBSERVATIONS and name != game.observation
    return str(name) if known else ""


def _absent(key: str) -> str:
    """What an environment has that does not mention `key`."""
    if key in _LATER:
        return json.dumps(_LATER[key])
    return "the package's own" if key.startswith(SCENE) else "nothing"
