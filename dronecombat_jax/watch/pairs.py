"""A fight of each pair of a tournament's win-rate maps, flown anew: `report/fights.html`.

Fight 0 of the pair, from the tournament's own start state. What does not live here: the page
(`report.pairs_page`), the maps (`report.map_panels`).
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.ticker import EngFormatter

from dronecombat_jax.analysis.result import Entrant, TournamentResult
from dronecombat_jax.analysis.study import Study
from dronecombat_jax.arena.lanes import fight_key, start_states
from dronecombat_jax.arena.match import policy_team, record, trajectory
from dronecombat_jax.arena.players import Player, content_words
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import digest_of, environment
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.report.map_panels import Panel, pairs_of, panel_of, panel_steps
from dronecombat_jax.report.pairs_page import PairsMap, pairs_data
from dronecombat_jax.report.replay_data import Fight
from dronecombat_jax.report.replay_page import pairs_page
from dronecombat_jax.report.shown_rules import rules_of
from dronecombat_jax.tournaments.entrants import Field, read_field
from dronecombat_jax.types import FightRecord, SidePolicy, Trajectory
from dronecombat_jax.watch.recording import joined

BATCH = 64  # pairs that fly side by side
MOST_PAIRS = 4000  # of a page
Pair = tuple[Player, Player]
Say = Callable[[str], None]


def fights_page(
    title: str, study: Study, about: Mapping[str, Any], say: Say = lambda _: None
) -> str | None:
    """The page of a tournament's pairs; None where it has no map of a run against itself.

    `about`: of `result.json`. Raises UserError where the players cannot be read any more, or know
    another game.
    """
    panels = [panel for method in study.methods if (panel := panel_of(study, method))]
    if not panels:
        return None
    field = _field(study.result, about)
    players = _players(field)
    pairs: list[tuple[Entrant, Entrant]] = []
    maps = [_map(study, panel, players, pairs) for panel in panels]
    if not pairs:
        raise UserError("no policy of the maps is at hand any more")
    if len(pairs) > MOST_PAIRS:
        raise UserError(f"{len(pairs)} pairs are too many for a page: at most {MOST_PAIRS}")
    say(f"flying a fight of each of {len(pairs)} pairs ...")
    combat = Combat(field.config)
    both = [(players[0][pair[0].identity], players[1][pair[1].identity]) for pair in pairs]
    flown = fly_pairs(combat, both, int(about["seed"]), bool(about["stochastic"]))
    fights = [
        Fight(fight, "Fight 1", (pair[0].label, pair[1].label))
        for pair, fight in zip(pairs, flown, strict=True)
    ]
    text = (
        "Click on a cell: a fight of that pair plays. It is the first of the fights that were counted, flown anew. "
        "Colours: the share of all fights that the defender wins, mean over seeds; yellow is much."
    )
    return pairs_page(pairs_data(title, text, maps, fights, rules_of(combat.config, combat.scene)))


def fly_pairs(
    combat: Combat, pairs: Sequence[Pair], seed: int, stochastic: bool = False
) -> list[Trajectory]:
    """Fight 0 of a tournament with `seed` for each pair of policies, in one program per network."""
    start = start_states(combat, seed, 1)

    @partial(jax.jit, static_argnums=0)
    def fly(
        views: tuple[tuple[bool, str], ...], policies: Sequence[SidePolicy], words: jax.Array
    ) -> Any:
        def fly_one(both: Sequence[SidePolicy], words: jax.Array) -> FightRecord:
            teams = [
                policy_team(
                    combat.config,
                    LearnConfig(normalize_observations=scaled),
                    both[role],
                    role,
                    stochastic,
                    observation,
                )
                for role, (scaled, observation) in enumerate(views)
            ]
            return record(
                combat,
                teams[0],
                teams[1],
                start,
                fight_key(jnp.uint32(seed), words, jnp.int32(0)),
            )

        return jax.vmap(fly_one)(policies, words)

    flown: dict[int, Trajectory] = {}
    for views, indices in _alike(pairs).items():
        for first in range(0, len(indices), BATCH):
            part = indices[first : first + BATCH]
            filled = [part[min(i, len(part) - 1)] for i in range(BATCH)]
            chosen = [[pairs[index][role] for index in filled] for role in (0, 1)]
            stack = lambda *leaves: np.stack(leaves)
            policies = [jax.tree.map(stack, *(player.pilot for player in side)) for side in chosen]
            words = [
                np.stack([content_words(player.identity) for player in side]) for side in chosen
            ]
            records = joined(jax.device_get(fly(views[0], policies, np.concatenate(words, axis=1))))
            flown |= {index: trajectory(combat, records, i) for i, index in enumerate(part)}
    return [flown[index] for index in range(len(pairs))]


def _alike(pairs: Sequence[Pair]) -> dict[Any, list[int]]:
    """Indices of pairs by what their program depends on."""
    groups: dict[Any, list[int]] = {}
    for index, pair in enumerate(pairs):
        shapes = tuple(tuple(np.shape(x) for x in jax.tree.leaves(player.pilot)) for player in pair)
        views = tuple((player.normalize, player.observation) for player in pair)
        groups.setdefault((views, shapes), []).append(index)
    return groups


def _field(result: TournamentResult, about: Mapping[str, Any]) -> Field:
    """Everybody who took part and is still there; UserError where that is another game."""
    runs = dict.fromkeys(entrant.run.split("/")[0] for entrant in result.defenders if entrant.run)
    words = about.get("words") or [*runs]
    field = read_field(
        words,
        every=int(about.get("every", 1)),
        untrained=bool(about.get("untrained", False)),
        skip_bad=True,
        allow_mismatch=True,
        mjcf=str(about.get("mjcf", "")),
        spawn=str(about.get("spawn", "")),
    )
    if digest_of(environment(field.config)) != about["environment_digest"]:
        raise UserError("the game of the policies is not that of the tournament any more")
    return field


def _players(field: Field) -> tuple[dict[str, Player], dict[str, Player]]:
    """The policies at hand, by identity."""
    sides = [
        {seat.entrant.identity: seat.player for seat in side if seat.player} for side in field.seats
    ]
    return sides[0], sides[1]


def _map(
    study: Study,
    panel: Panel,
    players: tuple[dict[str, Player], dict[str, Player]],
    pairs: list[tuple[Entrant, Entrant]],
) -> PairsMap:
    """One map; its pairs whose policies are at hand are added to `pairs`."""
    run = panel.runs[0]
    result = study.result
    numbers = np.full(panel.values.shape, -1)
    for cell in np.ndindex(numbers.shape):
        defender, attacker = pairs_of(study, panel, run)[cell]
        if defender < 0:
            continue
        both = result.defenders[defender], result.attackers[attacker]
        if all(entrant.identity in side for entrant, side in zip(both, players, strict=True)):
            numbers[cell] = len(pairs)
            pairs.append(both)
    spelt = EngFormatter(sep=" ")
    labels = [
        [spelt(float(f"{steps:.3g}")) for steps in side] for side in panel_steps(study, panel)
    ]
    seed = run.replace("#", ", seed ")
    return PairsMap(panel, f"Fights of {seed}", (labels[0], labels[1]), numbers)
