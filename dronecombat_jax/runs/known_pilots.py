"""Who comes with the package and can meet a frozen policy.

Fresh responders find a way past or they do not; somebody who learnt elsewhere may have one already.
So a policy's exploitability is at least what the best of both wins. What does not live here: their
fights, and the responders (`exploit`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax

from dronecombat_jax.arena.match import Team, policy_team, scripted_team
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import own_view
from dronecombat_jax.combat.scripted import PILOTS
from dronecombat_jax.errors import UserError
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import load_policy, require_environment
from dronecombat_jax.types import SIDES

# (a pilot's parameters, key) -> its wins and ties in a batch of fights
Fly = Callable[[Any, jax.Array], tuple[int, int]]


class Known(NamedTuple):
    """A pilot of the package, and what flies it."""

    name: str
    fly: Fly
    parameters: Any  # leaves without leading axes; none of a scripted pilot


def known_pilots(combat: Combat, role: int, against: Callable[..., Fly]) -> list[Known]:
    """All shipped policies that know this game, and the plain scripted pilots, of the side `role`.
    `against`: makes of who builds a team of parameters what flies it; compiled when it first flies,
    once for all that see alike.
    """
    config = combat.config

    def trained(observation: str, policy: Any) -> Team:
        return policy_team(config, config.learn, policy, role, observation=observation)

    def scripted(name: str, _: Any) -> Team:
        return scripted_team(combat, name, role)

    found, flights = [], {}
    for path in [shipped.FOLDER / f"{name}.safetensors" for name in shipped.names()]:
        saved = load_policy(path)
        if saved.info.role != SIDES[role]:
            continue
        try:
            require_environment(saved.info, config)
        except UserError:  # it was trained in another game
            continue
        view = own_view(saved.info.environment, config.game)
        if view not in flights:
            flights[view] = against(partial(trained, view))
        found.append(Known(path.stem, flights[view], saved.policy))
    plain = [Known(name, against(partial(scripted, name)), ()) for name in PILOTS[role]]
    return [*found, *plain]
