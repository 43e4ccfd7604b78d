"""The numbers behind a tournament's report as tables: rows of plain values, for CSV, JSON and the
page.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from dronecombat_jax.analysis.design import BOUNDED, OPEN_ABOVE, OPEN_BELOW
from dronecombat_jax.analysis.forgetting import summarise_maps
from dronecombat_jax.analysis.map_tests import map_tests
from dronecombat_jax.analysis.result import score_rate, scores
from dronecombat_jax.analysis.study import Study, own_elo_by_side
from dronecombat_jax.files.plain import Table, plain_value, to_csv
from dronecombat_jax.report.sheet import mean_and_spread, timelines_of
from dronecombat_jax.types import SIDES, Cause

GAUGE = "Elo points; the mean over all entrants of both roles is 1500"
BOUNDS = {BOUNDED: "both ends", OPEN_ABOVE: "open above", OPEN_BELOW: "open below"}


def tables(study: Study) -> tuple[Table, ...]:
    """All tables of a report."""
    return (
        ratings(study),
        elo_over_time(study),
        maps(study),
        cell_tests(study),
        memory(study),
        cyclic(study),
        populations(study),
        endings(study),
    )


def ratings(study: Study) -> Table:
    """Every entrant with its fights and all ratings."""
    result, table, rated = study.result, scores(study.result), study.ratings
    parts = [np.concatenate([values.sum(axis=1), values.sum(axis=0)]) for values in table]
    wins, ties, losses = parts
    cut = len(result.defenders)
    # an attacker wins what a defender loses
    wins[cut:], losses[cut:] = parts[2][cut:].copy(), parts[0][cut:].copy()
    games = np.maximum(wins + ties + losses, 1e-300)
    elo, scale = study.elo_scale, study.scale
    smooth = (
        np.full(len(games), np.nan) if study.smooth_scale is None else study.smooth_scale.rating
    )
    nash, rank = _in_part(study)
    own, nothing = study.own_elo, np.full(len(games), np.nan)
    rows = [
        (
            SIDES[i >= cut], entrant.label, entrant.method, entrant.run, entrant.seed, entrant.chunk, entrant.steps, entrant.identity,
            wins[i], ties[i], losses[i], (wins[i] + ties[i] / 2) / games[i] if games[i] >= 1 else np.nan,
            scale.rating[i], rated.error[i], scale.low[i], scale.high[i],
            BOUNDS.get(int(rated.design.bound[i]), "open both ways"), rated.design.component[i],
            study.davidson.rating[i] if games[i] >= 1 else np.nan, study.davidson.error[i],
            elo.rating[i], elo.high[i] - elo.rating[i], own.get(entrant.lineage, nothing)[i], smooth[i], nash[i], rank[i],
            "; ".join(name.label for name in entrant.also),
        )
        for i, entrant in enumerate(study.entrants)
    ]  # fmt: skip
    columns = (
        "role label method run seed chunk steps identity wins draws losses mean_score bradley_terry standard_error "
        "low_95 high_95 interval component davidson davidson_error elo elo_spread_over_orders elo_in_own_run smoothed "
        "nash_average alpha_rank also_saved_as"
    )
    about = (
        f"{GAUGE}; elo_in_own_run: the same within each run. Component: ratings of two components cannot be compared. "
        f"Bradley-Terry counts a tie as half a win; its errors take fights as independent and strengths as additive "
        f"(Pearson dispersion {rated.dispersion:.2f}, 1 if so). Davidson's model has ties of their own (nu "
        f"{study.davidson.tie:.3g}). also_saved_as: the same policy at other times, which flew once."
    )
    return _table("ratings", about, columns.split(), rows)


def elo_over_time(study: Study) -> Table:
    """The numbers of the paper's figures 4 and 5."""
    rows = []
    for role, side, values in own_elo_by_side(study):
        for method, line in timelines_of(side, values, study.methods).items():
            series = zip(line.steps, *mean_and_spread(line.values), strict=True)
            rows += [(method, role, *row) for row in series]
    about = "Elo of each run in its own tournament (there the mean over all entrants is 1500); mean over seeds."
    return _table(
        "elo_over_time",
        about,
        ["method", "role", "steps", "mean", "standard_deviation", "seeds"],
        rows,
    )


def maps(study: Study) -> Table:
    """The numbers of the paper's figures 6 to 9, with all defenders."""
    rows = []
    for method, members in study.win_maps.items():
        if members:
            summary, chunks = summarise_maps(members), members[0].chunks
            for i, j in np.argwhere(summary.runs > 0):
                rows.append(
                    (
                        method,
                        chunks[i],
                        chunks[j],
                        summary.mean[i, j],
                        summary.variance[i, j],
                        summary.runs[i, j],
                    )
                )
    columns = [
        "method",
        "defender_chunk",
        "attacker_chunk",
        "win_rate",
        "variance_over_seeds",
        "seeds",
    ]
    return _table(
        "win_rates",
        "Share of fights won by the defender, against attackers of its own run.",
        columns,
        rows,
    )


def cell_tests(study: Study) -> Table:
    """Where the maps of two methods differ."""
    rows = [
        (
            map_test.first,
            map_test.second,
            map_test.defenders[i],
            map_test.attackers[j],
            map_test.difference[i, j],
            map_test.adjusted_p[i, j],
        )
        for map_test in map_tests(study.win_maps)
        for i, j in np.ndindex(map_test.difference.shape)
    ]
    about = (
        "Win rate of the first method minus that of the second, ten defenders, and the p-value adjusted for all cells of "
        "the map at once (max-T permutation of the training seeds)."
    )
    columns = ["first", "second", "defender_chunk", "attacker_chunk", "difference", "adjusted_p"]
    return _table("win_rate_tests", about, columns, rows)


def memory(study: Study) -> Table:
    """Forgetting, run by run."""
    method = {entrant.lineage: entrant.method for entrant in study.entrants}
    rows = [
        (
            method[run], run, item.defender.backward_transfer, item.defender.final_worst,
            item.attacker.backward_transfer, item.attacker.final_worst, item.home, item.away, item.home - item.away,
        )
        for run, item in study.memory.items()
    ]  # fmt: skip
    columns = (
        "method run defender_backward_transfer defender_worst_past attacker_backward_transfer attacker_worst_past "
        "final_defender_home final_defender_away home_minus_away"
    )
    about = (
        "Mean scores, a win 1 and a tie 1/2. Backward transfer below 0: the final policy lost what "
        "it could. Worst cases and home scores tell of the own attackers' strength, too; methods are "
        "compared by them after an adjustment for it."
    )
    return _table("forgetting", about, columns.split(), rows)


def cyclic(study: Study) -> Table:
    """The cyclic share of the whole tournament and of each method."""
    rows = []
    for name, item in study.cyclic.items():
        shape = study.cyclic_part[name].played.shape
        numbers = (None,) * 6 if item is None else (*item[:5], item.disc_share)
        rows.append((name, *shape, *numbers))
    columns = "part defenders attackers raw corrected noise noise_95 p_value disc_share"
    return _table(
        "cyclic",
        "Share of the score logits' variance that no rating explains.",
        columns.split(),
        rows,
    )


def populations(study: Study) -> Table:
    """The value of each method's defenders against all attackers."""
    rows = [(method, item.value, item.low, item.high) for method, item in study.populations.items()]
    about = "Mean score of the defenders of a method as one mixture against the best mixture of all attackers."
    return _table(
        "population_value",
        about,
        ["method", "value", "low_95_over_starts", "high_95_over_starts"],
        rows,
    )


def endings(study: Study) -> Table:
    """How fights end and how long they last, entrant by entrant."""
    causes = [cause for cause in Cause if cause]
    rows = []
    for role, side, ending in zip(
        SIDES, (study.result.defenders, study.result.attackers), study.endings, strict=True
    ):
        for i, entrant in enumerate(side):
            rows.append(
                (
                    role,
                    entrant.label,
                    entrant.identity,
                    entrant.steps,
                    ending.fights[i],
                    *ending.share[i, causes],
                    *ending.duration[i],
                )
            )
    columns = [
        "role",
        "label",
        "identity",
        "steps",
        "fights",
        *(cause.name.lower() for cause in causes),
    ]
    about = "Shares of all fights of an entrant, and quartiles of their length in seconds."
    return _table(
        "endings", about, [*columns, "duration_q1", "duration_median", "duration_q3"], rows
    )


def score_matrix(study: Study) -> str:
    """The defender's mean scores [D, A] as CSV, empty where not played."""
    result = study.result
    rate = score_rate(result)
    rows = [
        (entrant.identity, *values) for entrant, values in zip(result.defenders, rate, strict=True)
    ]
    return to_csv(
        _table(
            "scores", "", ["defender", *(attacker.identity for attacker in result.attackers)], rows
        )
    )


def _in_part(study: Study) -> tuple[list[float], list[float]]:
    """Nash average and alpha-Rank of every player; NaN outside the part without missing cells."""
    places = [
        {entrant.identity: i for i, entrant in enumerate(side)}
        for side in (study.nash_part.defenders, study.nash_part.attackers)
    ]
    parts: tuple[list[float], list[float]] = ([], [])
    sources = (
        None if study.nash is None else (study.nash.defender, study.nash.attacker),
        study.alpha_rank,
    )
    for role, side in enumerate((study.result.defenders, study.result.attackers)):
        for entrant in side:
            place = places[role].get(entrant.identity)
            for numbers, source in zip(parts, sources, strict=True):
                numbers.append(
                    math.nan if place is None or source is None else float(source[role][place])
                )
    return parts


def _table(name: str, about: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Table:
    made = tuple(tuple(plain_value(cell) for cell in row) for row in rows)
    return Table(name, about, tuple(columns), made)
