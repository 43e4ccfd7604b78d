"""`dronecombat rate`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from dronecombat_jax.cli.start import prepare, rate_on_one_core
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting
from dronecombat_jax.config.starts import AS_TRAINED
from dronecombat_jax.errors import UserError


@dataclass(frozen=True)
class RateFlags:
    """Rate a policy on the ladder that comes with the package: rating with interval, place, and who
    beats it.

    It meets all shipped and scripted pilots of the other side, from starts that are the same each
    time, and flies in the layout of observations that its own file names. Such as

        dronecombat rate my_policy.safetensors
        dronecombat rate ippo --role attacker
        dronecombat rate pilots:sippo-defender
        dronecombat rate strong --spawn even
    """

    policy: str = setting(
        "", "a policy file, a run (its newest, of both sides), pilots:NAME or scripted:NAME"
    )
    role: Literal["both", "defender", "attacker"] = setting("both", "of a run: whose policy")
    fights: int = setting(
        0, "fights against each opponent; 0: as many as the ladder's own", low=0, high=10**4
    )
    spawn: Literal["as_trained", "even"] = setting(
        AS_TRAINED,
        "which ladder: as_trained, fights from rest at the paper's points; even, the defender so far "
        "back that the best plain scripted pilots of both sides win about as often",
    )
    allow_env_mismatch: bool = setting(
        False, "rate a policy of another game in that of the ladder all the same"
    )
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


def rate(args: Sequence[str]) -> int:
    """how a policy stands on the ladder that comes with the package"""
    given: RateFlags = flags.read(RateFlags, args, "dronecombat rate", positional="policy")
    if not given.policy:
        raise UserError("POLICY is missing: a policy file, a run, pilots:NAME or scripted:NAME")
    rate_on_one_core()
    prepare(given.device)
    from dronecombat_jax.tournaments import newcomers

    role = "" if given.role == "both" else given.role
    ratings = newcomers.rate(
        given.policy,
        role=role,
        fights=given.fights,
        allow_mismatch=given.allow_env_mismatch,
        spawn=given.spawn,
    )
    for rated in ratings:
        print(newcomers.rated_text(rated))
    return 0
