"""`dronecombat train`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from dronecombat_jax.config import body_file, flags, settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import SIDES
from dronecombat_jax.config.schema import settings_of, shown
from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.settings import Given
from dronecombat_jax.errors import UserError

DEFAULT_PRESET = "duel"
ROLE = "attacker"  # that learns --against somebody
SHORT_FLAGS = {
    "run.name": "--name",
    "run.device": "--device",
    "train.seed": "--seed",
    "train.total_steps": "--steps",
}


@dataclass(frozen=True)
class TrainFlags(Config):
    """Train attacker and defender. A flag counts before the preset, the preset before a default.

    The same command again goes on where the run was stopped or killed. Such as

        dronecombat train --preset smoke
        dronecombat train --preset duel --name ippo
        dronecombat train --preset duel --name sippo --selfplay.probability 0.2 --seed 3
        dronecombat train --name response --against pilots:ippo-defender --role attacker
    """

    preset: str = setting(
        DEFAULT_PRESET, f"one of {', '.join(settings.presets())}, or a .toml file"
    )
    print_config: bool = setting(False, "print every setting as TOML and stop")
    fork: str = setting(
        "", "name of a new run that begins from a checkpoint of the run --name, with other settings"
    )
    fork_chunk: int = setting(
        -1, "which checkpoint to fork (0: the untrained one); -1: the newest", low=-1, high=10**9
    )
    against: str = setting(
        "",
        "train one side against somebody who does not learn: scripted:NAME, pilots:NAME, a policy file, RUN or "
        "RUN:CHUNK (the same as --selfplay.opponents OTHER_SIDE=WHO)",
    )
    role: Literal["defender", "attacker"] = setting(ROLE, "which side learns --against somebody")


def train(args: Sequence[str]) -> int:
    """train attacker and defender"""
    given, errors = flags.parse(TrainFlags, args, "dronecombat train", aliases=SHORT_FLAGS)
    preset, only_print = given.pop("preset", DEFAULT_PRESET), given.pop("print_config", False)
    fork = {key: given.pop(key) for key in ("fork", "fork_chunk") if key in given}
    own = {key: Given(value, settings.flag(key)) for key, value in fork.items()}
    errors += settings.check(own, settings_of(TrainFlags))
    if "fork" not in fork and fork:
        errors.append("--fork-chunk needs --fork NEW_NAME")
    errors += _against(given)
    try:
        config = settings.load(preset, given, check_machine=True)
    except UserError as error:
        raise UserError("\n".join([*errors, error.message])) from None
    if errors:
        raise UserError("\n".join(errors))
    config = settings.as_run(config, preset)
    if only_print:
        print(settings.to_toml(config), end="")
        return 0
    print(summary(config, preset), flush=True)
    from dronecombat_jax.machine.start import prepare_training

    prepare_training(config)
    if config.sim.mjcf or body_file.is_file(
        config.sim.body
    ):  # what cannot be flown is said before there is a folder
        from dronecombat_jax.sim.scene import load_scene

        load_scene(config.sim, sides=config.game.sides)
    from dronecombat_jax.machine import processes
    from dronecombat_jax.runs import training

    with processes.parting():
        if "fork" in fork:
            new = replace(config, run=replace(config.run, name=fork["fork"]))
            chunk = fork.get("fork_chunk", -1)
            config, code = new, training.train(new, config.run.name, chunk if chunk >= 0 else None)
        else:
            code = training.train(config)
    if code or not processes.first():
        return code
    from dronecombat_jax.watch import finish

    finish.finish(config)
    return 0


def _against(given: dict[str, Any]) -> list[str]:
    """Turn --against and --role in `given` into the table of opponents; returns what is wrong."""
    flagged = {key: given.pop(key) for key in ("against", "role") if key in given}
    own = {key: Given(value, settings.flag(key)) for key, value in flagged.items()}
    if errors := settings.check(own, settings_of(TrainFlags)):
        return errors
    word = flagged.get("against")
    if word is None:
        return ["--role needs --against OPPONENT"] if flagged else []
    if "selfplay.opponents" in given:
        return ["--against and --selfplay.opponents say the same: write one of them"]
    if not word.strip():
        return ["--against: it names nobody"]
    role = flagged.get("role", ROLE)
    given["selfplay.opponents"] = f"{SIDES[1 - SIDES.index(role)]}={word.strip()}"
    return []


def summary(config: Config, preset: str) -> str:
    """The settings that differ from the defaults, one line each, and how to see the rest."""
    lines = [f"settings: preset {preset}; these differ from the defaults:"]
    for key, default, value in settings.diff(Config(), config):
        lines.append(f"  {key} = {shown(value)} (default {shown(default)})")
    return "\n".join([*lines, "  (all of them: the same command with --print-config)"])
