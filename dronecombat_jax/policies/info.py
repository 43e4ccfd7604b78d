"""What a policy file says about its policy: typed here, text in the file. No trust in the text.

The meaning of every name: `docs/policies.md`. What does not live here: the arrays and the file
(`policy`).
"""

import hashlib
import json
import re
from typing import Any, NamedTuple

from dronecombat_jax.combat.fingerprint import canonical
from dronecombat_jax.combat.observe import OBSERVATIONS, Observation, layout_of
from dronecombat_jax.config.fields import GameConfig, LearnConfig
from dronecombat_jax.config.schema import build, one_line, shown
from dronecombat_jax.config.settings import SCHEMA
from dronecombat_jax.learn.networks import encoded_size
from dronecombat_jax.learn.normalize import CLIP, EPSILON
from dronecombat_jax.types import ACTION_SIZE, SIDES

FORMAT = "dronecombat-policy"
FORMAT_VERSION = 3  # 1: a policy without memory, 2: with it, 3: policies of team mates
ACTIVATION = "elu"
_WRENCH = ("thrust", "moment_x", "moment_y", "moment_z")  # body frame (`sim.flight.wrench`)
ACTION_FIELDS = {  # by `sim.actuation`
    "wrench": _WRENCH,
    "mixed": _WRENCH,
    "rotors": ("rotor_front_right", "rotor_back_right", "rotor_back_left", "rotor_front_left"),
    "ctbr": ("thrust", "rate_x", "rate_y", "rate_z"),
}
# settings of a game that its observation's size depends on
SHAPING = ("game.nearest_k", "game.defenders", "game.attackers")
ACTION_CLIP = 1.0  # what the game does to an action before it flies it
_ID = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._+-]{0,99}")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,17}")
_SHA256 = re.compile(r"[0-9a-f]{64}")
NO_MEMORY = "none"
_MEMORY = re.compile(r"frames ([2-9]|[1-5][0-9]|6[0-4])|gru ([1-9][0-9]{0,2}|10[01][0-9]|102[0-4])")


class PolicyInfo(NamedTuple):
    """What a file says about its policy; `metadata_of` spells it as text."""

    role: str  # "defender" or "attacker"
    layer_sizes: tuple[int, ...]  # from observation to action
    normalize_observations: bool  # whether the network sees scaled observations
    environment: dict[str, Any]  # `combat.fingerprint.environment`: the game that it was trained in
    run: str
    seed: int
    chunk: int
    steps: int  # environment steps of that seed
    package_version: str
    jax_version: str
    config_sha256: str  # of the run's config.toml
    others_size: int = 0  # units of the layer for slots of others (`types.Encoder`); 0: none
    # what it remembers of its fight: "none"; "frames K": the first layer takes K observations;
    # "gru H": it takes an observation and the H numbers of a GRU's state
    memory: str = NO_MEMORY
    mates: int = 1  # policies in the file: one for all drones of its side, or one for each
    drone: int = 0  # whose alone it is of a side whose drones each have one, from 1; 0: all of them

    @property
    def first_inputs(self) -> int:
        """Inputs of the first layer: the observation, or what an encoder or a memory makes of it."""
        if self.others_size:
            return encoded_size(self.others_size)
        kind, _, number = self.memory.partition(" ")
        seen = self.layer_sizes[0]
        return {"frames": lambda: seen * int(number), "gru": lambda: seen + int(number)}.get(
            kind, lambda: seen
        )()

    @property
    def gru_size(self) -> int:
        """Numbers of a GRU's state; 0: it has none."""
        kind, _, number = self.memory.partition(" ")
        return int(number) if kind == "gru" else 0

    @property
    def observation(self) -> str:
        """Name of the observation's layout, of `OBSERVATIONS`."""
        return self.environment["game.observation"]

    @property
    def actuation(self) -> str:
        """What an action is: a key of `ACTION_FIELDS`."""
        return self.environment.get("sim.actuation", "wrench")  # files from before it lack it

    @property
    def control_dt(self) -> float:
        """Seconds per control step."""
        return self.environment["sim.timestep"] * self.environment["sim.substeps"]

    @property
    def environment_sha256(self) -> str:
        """Equal to `combat.fingerprint.environment_digest` of the run's configuration."""
        return hashlib.sha256(canonical(self.environment).encode()).hexdigest()


def memory_of(learn: LearnConfig) -> str:
    """What the policies of a run remember, as `PolicyInfo.memory` says it."""
    if learn.memory == "gru":
        return f"gru {learn.memory_size}"
    return f"frames {learn.frames}" if learn.memory == "frames" else NO_MEMORY


def metadata_of(info: PolicyInfo) -> dict[str, str]:
    """Everything but the arrays, every value as text.

    Of one policy without memory it is that of format 1.
    """
    remembers, apart = info.memory != NO_MEMORY, info.mates > 1
    return {
        "format": FORMAT,
        "format_version": str(3 if apart else 2 if remembers else 1),
        "role": info.role,
        "layer_sizes": json.dumps(info.layer_sizes),
        "activation": ACTIVATION,
        "observation": info.observation,
        "observation_fields": json.dumps(_layout(info.environment).fields),
        "normalize_observations": json.dumps(info.normalize_observations),
        "normalization_clip": repr(CLIP),
        "normalization_epsilon": repr(EPSILON),
        "action_fields": json.dumps(ACTION_FIELDS[info.actuation]),
        "action_clip": repr(ACTION_CLIP),
        "control_dt": repr(info.control_dt),
        "environment": canonical(info.environment),
        "environment_sha256": info.environment_sha256,
        "run": info.run,
        "seed": str(info.seed),
        "chunk": str(info.chunk),
        "steps": str(info.steps),
        "package_version": info.package_version,
        "jax_version": info.jax_version,
        "config_sha256": info.config_sha256,
        **({"memory": info.memory} if remembers else {}),
        **({"others_size": str(info.others_size)} if info.others_size else {}),
        **({"mates": str(info.mates)} if apart else {}),
        **({"drone": str(info.drone)} if info.drone else {}),
    }


def info_of(metadata: dict[str, str]) -> PolicyInfo:
    """The metadata of a file as data; unknown keys are ignored.

    Raises ValueError, one line, unless every value is what this version would write for the same
    policy.
    """
    if metadata.get("format") != FORMAT:
        raise ValueError(f"no policy of dronecombat: its metadata lack format = {FORMAT}")
    if (version := _whole(metadata, "format_version")) > FORMAT_VERSION:
        raise ValueError(
            f"it has format {version}, this version reads up to {FORMAT_VERSION}: upgrade dronecombat-jax"
        )
    environment = _environment(metadata)
    remembers = version == 2 or (version > 2 and "memory" in metadata)
    role = _matching(metadata, "role", re.compile("|".join(SIDES)))
    team = environment.get(f"game.{role}s", 1)
    info = PolicyInfo(
        role=role,
        layer_sizes=_layer_sizes(metadata, environment),
        normalize_observations=_matching(
            metadata, "normalize_observations", re.compile("true|false")
        )
        == "true",
        environment=environment,
        run=_matching(metadata, "run", _ID),
        seed=_whole(metadata, "seed"),
        chunk=_whole(metadata, "chunk"),
        steps=_whole(metadata, "steps"),
        package_version=_matching(metadata, "package_version", _ID),
        jax_version=_matching(metadata, "jax_version", _ID),
        config_sha256=_matching(metadata, "config_sha256", _SHA256),
        others_size=_others_size(metadata, environment),
        memory=_matching(metadata, "memory", _MEMORY) if remembers else NO_MEMORY,
        mates=_whole(metadata, "mates", team, team) if version > 2 else 1,
        drone=_whole(metadata, "drone", 1, team) if "drone" in metadata else 0,
    )
    for key, expected in metadata_of(info).items():
        if metadata.get(key) != expected:
            raise _wrong(metadata, key, f"expected {one_line(expected)}")
    return info


def _layer_sizes(metadata: dict[str, str], environment: dict[str, Any]) -> tuple[int, ...]:
    sizes, hidden = _json(metadata, "layer_sizes"), SCHEMA["learn.hidden_sizes"]
    seen = _layout(environment).size
    ends = isinstance(sizes, list) and (sizes[0:1], sizes[-1:]) == ([seen], [ACTION_SIZE])
    if not ends or hidden.problem(sizes[1:-1]):
        raise _wrong(metadata, "layer_sizes", f"expected {seen}, {hidden.allowed}, {ACTION_SIZE}")
    return tuple(sizes)


def _others_size(metadata: dict[str, str], environment: dict[str, Any]) -> int:
    if "others_size" not in metadata:
        return 0
    size, setting = _whole(metadata, "others_size"), SCHEMA["learn.others_size"]
    if setting.problem(size):
        raise _wrong(metadata, "others_size", f"expected {setting.allowed}")
    if environment["game.observation"] != "nearest":
        raise ValueError(f"metadata others_size is {size}: game.observation must be nearest")
    return size


def _layout(environment: dict[str, Any]) -> Observation:
    """The observation of a game whose settings have been checked."""
    known = {key: environment[key] for key in SHAPING if key in environment}
    return layout_of(environment["game.observation"], build(GameConfig, known, "game."))


def _environment(metadata: dict[str, str]) -> dict[str, Any]:
    game = _json(metadata, "environment")
    if not isinstance(game, dict):
        raise _wrong(metadata, "environment", "expected an object")
    for key in ("sim.timestep", "sim.substeps", "game.observation"):
        # what other metadata are made from
        if fault := SCHEMA[key].problem(game.get(key)):
            raise ValueError(f"metadata environment: {key} = {shown(game.get(key))}: {fault}")
    if (seen := game["game.observation"]) not in OBSERVATIONS:  # a file never names code to run
        known = ", ".join(OBSERVATIONS)
        raise ValueError(f"metadata environment: game.observation = {shown(seen)}: not {known}")
    for key in (key for key in SHAPING if key in game):
        if fault := SCHEMA[key].problem(game[key]):
            raise ValueError(f"metadata environment: {key} = {shown(game[key])}: {fault}")
    if (given := game.get("sim.actuation", "wrench")) not in ACTION_FIELDS:
        fault = SCHEMA["sim.actuation"].problem(given)
        raise ValueError(f"metadata environment: sim.actuation = {shown(given)}: {fault}")
    return game


def _json(metadata: dict[str, str], key: str) -> Any:
    try:
        return json.loads(metadata.get(key, ""))
    except ValueError:
        raise _wrong(metadata, key, "expected JSON") from None


def _whole(metadata: dict[str, str], key: str, low: int = 0, high: int = 10**18) -> int:
    number = int(_matching(metadata, key, _WHOLE))
    if not low <= number <= high:
        raise _wrong(metadata, key, f"expected {low} to {high}, by the size of its team")
    return number


def _matching(metadata: dict[str, str], key: str, pattern: re.Pattern[str]) -> str:
    text = metadata.get(key, "")
    if not pattern.fullmatch(text):
        raise _wrong(metadata, key, f"expected {pattern.pattern}")
    return text


def _wrong(metadata: dict[str, str], key: str, expected: str) -> ValueError:
    got = one_line(metadata[key]) if key in metadata else "missing"
    return ValueError(f"metadata {key} is {got}: {expected}")
