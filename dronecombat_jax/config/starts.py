"""Other starts than those that a run was trained with, by name. Nothing imports JAX."""

from dataclasses import replace

from dronecombat_jax.config.fields import Config

AS_TRAINED = "as_trained"
STARTS = (
    "where the fights start: fixed, the paper's three points; uniform, anywhere; even, the defender "
    "so far back that the best plain scripted pilots of both sides win about as often"
)
EVEN_SETBACK = 2.0  # m; docs/pilots.md, "Even starts"


def with_starts(config: Config, starts: str) -> Config:
    """The game with other starts; "" or `as_trained` leaves it as it is.

    `fixed`: the paper's three points; `uniform`: anywhere in the arena; `even`: as trained, but the
    defender `EVEN_SETBACK` farther from the target, so that the best plain scripted pilots of both
    sides win about as often.
    """
    game = config.game
    if starts in ("", AS_TRAINED):
        return config
    if starts == "even":
        return replace(config, game=replace(game, spawn="fixed", defender_setback=EVEN_SETBACK))
    game = replace(game, spawn=starts, spawn_spread=0.0, defender_spread=0.0, defender_setback=0.0)
    return replace(config, game=game)
