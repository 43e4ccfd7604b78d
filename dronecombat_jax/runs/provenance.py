"""What a checkpoint says about itself beside its arrays, and whether this machine would go on as it
began. Plain JSON.
"""

from typing import Any

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.files.manifest import CheckpointError
from dronecombat_jax.files.versions import package_version
from dronecombat_jax.runs.resume import Start


def describe(config: Config, iteration: int, met: dict[str, Any] | None = None) -> dict[str, Any]:
    """The meta of a checkpoint after `iteration` iterations: settings, environment and versions.

    `met`: the environment as it is flown, whatever was done to its files since; None: as it is now.
    """
    import jax

    from dronecombat_jax.combat.fingerprint import digest_of, environment

    met = met or environment(config)
    return {
        "config": settings.to_toml(config),
        "steps": iteration * config.steps_per_iteration,
        "environment": met,
        "environment_digest": digest_of(met),
        "package": package_version(),
        "jax": jax.__version__,
        "random": _random(),
    }


def check_meta(start: Start, config: Config, met: dict[str, Any] | None = None) -> list[str]:
    """Notes for a person about going on from `start`; a checkpoint without these facts gives none.

    `met`: the environment that is flown here, as in `describe`. Raises CheckpointError where it is
    not the checkpoint's, or where other random numbers would come out of the same seeds.
    """
    import jax

    from dronecombat_jax.combat.fingerprint import environment, environment_diff

    saved, here = start.meta.get("environment"), met or environment(config)
    if isinstance(saved, dict) and not start.changed and (lines := environment_diff(saved, here)):
        raise CheckpointError(
            f"{start.path} was made in another environment: {'; '.join(lines)}. "
            "Choose another --name, or --fork NEW_NAME to go on in this one"
        )
    if (random := start.meta.get("random", _random())) != _random():
        raise CheckpointError(
            f"{start.path} was made with the random numbers of {_spelt(random)}, and JAX is set to {_spelt(_random())}: "
            "unset JAX_DEFAULT_PRNG_IMPL and JAX_THREEFRY_PARTITIONABLE, or set them as they were"
        )
    if (version := start.meta.get("jax", jax.__version__)) != jax.__version__:
        return [
            f"note: made with jax {version}, goes on with {jax.__version__}: no longer the same bits"
        ]
    return []


def _random() -> dict[str, Any]:
    """What random bits depend on besides the seed."""
    import jax

    options: Any = jax.config  # which of them jax declares differs between its versions
    return {
        "generator": options.jax_default_prng_impl,
        "partitionable": options.jax_threefry_partitionable,
    }


def _spelt(random: Any) -> str:
    return (
        ", ".join(f"{key} {value}" for key, value in random.items())
        if isinstance(random, dict)
        else str(random)
    )
