"""Rules for a table of opponents and the settings beside it, checked before anything is allocated.

What does not live here: its spelling and its meaning (`opponents`), whether its files and pilots
are there (`runs.opponents`). Nothing imports JAX.
"""

from collections.abc import Iterator
from typing import get_args, get_type_hints

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import (
    NOBODY,
    SIDES,
    Row,
    learns,
    live_part,
    parse,
    places,
    table,
)
from dronecombat_jax.config.own import OWN
from dronecombat_jax.config.problem import Problem
from dronecombat_jax.config.training_fields import SelfPlayConfig

KEY = "selfplay.opponents"
SAMPLERS = get_args(get_type_hints(SelfPlayConfig)["sampler"])
_EXACT = 1e-9  # sums of shares in binary


def misspelt(config: Config) -> list[Problem]:
    """The problem of a table that cannot be read; no other rule can then be checked."""
    try:
        parse(config.selfplay.opponents)
    except ValueError as error:
        return [Problem((KEY,), f"{KEY}: {error}")]
    return []


def broken(config: Config) -> Iterator[Problem]:
    """All rules that a readable table breaks."""
    if not config.selfplay.opponents:
        return
    rows = parse(config.selfplay.opponents)
    yield from _beside(config, rows)
    for row in rows:
        if row.sampler and row.sampler not in SAMPLERS and not OWN.fullmatch(row.sampler):
            known = ", ".join(SAMPLERS)
            yield Problem((KEY,), f"{KEY}: {row.name}: no sampler has this name ({known})")
    whole = [row for row in table(config) if not row.of_chunks]
    total = sum(row.share or 0.0 for row in whole)
    if total > 1.0 + _EXACT or any(row.share is not None and row.share <= 0.0 for row in whole):
        solo = config.train.solo_share
        more = f", train.solo_share = {solo:g} among them" if solo else ""
        yield Problem(
            (KEY, "train.solo_share"), f"{KEY}: shares of more than all environments{more}"
        )
        return
    for row in rows:
        if row.past and not learns(config, row.side):
            text = f"{KEY}: {row.name}: its live {SIDES[row.side]} flies nowhere, so that it has no past"
            yield Problem((KEY,), text)
    for place in places(config):
        if place.row is not None and place.stop <= place.first:
            envs = config.train.num_envs
            yield Problem(
                (KEY, "train.num_envs"),
                f"{KEY}: {place.row.name}: {place.row.share:g} of train.num_envs = {envs} is no environment",
            )
    yield from _batches(config)


def _beside(config: Config, rows: tuple[Row, ...]) -> Iterator[Problem]:
    """Settings that do not go with a table."""
    selfplay, train = config.selfplay, config.train
    if selfplay.probability > 0.0:
        text = f"{KEY} spells all opponents: leave selfplay.probability out, or write attacker=past SHARE of chunks"
        yield Problem((KEY, "selfplay.probability"), text)
    if not selfplay.restore_live:
        yield Problem(
            ("selfplay.restore_live", KEY), f"selfplay.restore_live = false does not go with {KEY}"
        )
    if config.game.scenario == "solo":
        text = f'{KEY} needs game.scenario = "duel": in "solo" the attacker flies alone'
        yield Problem((KEY, "game.scenario"), text)
    if train.solo_share > 0.0 and any(row.who == NOBODY for row in rows):
        text = f"{KEY}: defender=nobody and train.solo_share = {train.solo_share:g} say the same: write --train.solo-share 0"
        yield Problem((KEY, "train.solo_share"), text)
    if config.run.distributed and any(row.policy for row in rows):
        text = f"run.distributed: several processes cannot train against policies yet ({KEY})"
        yield Problem(("run.distributed", KEY), text)


def _batches(config: Config) -> Iterator[Problem]:
    """The part of the rollout that a side learns from must divide into its mini-batches."""
    learn = config.learn
    if config.steps_per_iteration % learn.minibatches:
        return  # said already
    for side, name in enumerate(SIDES):
        part = live_part(config, side)
        envs = part.stop - part.start
        if envs * learn.rollout_steps % learn.minibatches:
            yield Problem(
                (KEY, "learn.minibatches", "train.num_envs", "learn.rollout_steps"),
                f"{KEY} leaves the {name} {envs} environments and {envs * learn.rollout_steps} steps a rollout, "
                f"which must be a multiple of learn.minibatches = {learn.minibatches}",
            )
