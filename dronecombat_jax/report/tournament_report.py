"""`dronecombat report`: a tournament's figures, tables and one page that shows them all."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from dronecombat_jax.analysis import map_tests
from dronecombat_jax.analysis.gaps import seeds_of
from dronecombat_jax.analysis.panel import EVERY
from dronecombat_jax.analysis.result import TournamentResult
from dronecombat_jax.analysis.study import Effort, Study, study
from dronecombat_jax.analysis.verdict import judge
from dronecombat_jax.analysis.verdict_text import verdict_json, verdict_text
from dronecombat_jax.errors import UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.files.plain import one_line, records, to_csv, to_json
from dronecombat_jax.report.claims_report import write_claims, write_protocol
from dronecombat_jax.report.cyclic_figure import cyclic_discs
from dronecombat_jax.report.figures import save_figure
from dronecombat_jax.report.flight_figure import flight_over_time, flight_table
from dronecombat_jax.report.map_figures import score_map, variance_map, win_rate_map
from dronecombat_jax.report.map_panels import areas
from dronecombat_jax.report.page import FIGHTS_NAME, Picture, page, with_links
from dronecombat_jax.report.protocol_figure import protocol_figure
from dronecombat_jax.report.ratings_figures import elo_over_time, finals, ratings_over_time
from dronecombat_jax.report.structure_figures import forgetting_profile, outcomes_over_time
from dronecombat_jax.report.tables import score_matrix, tables
from dronecombat_jax.tournaments.flights import Flown, load_flights
from dronecombat_jax.tournaments.grouping import as_compared
from dronecombat_jax.tournaments.result_file import find_tournament, load_about, load_result

# file: heading, what draws it, what it shows
FIGURES: dict[str, tuple[str, Callable[[Study], Figure], str]] = {
    "elo_over_time": ("Elo over training", elo_over_time, "As the paper's figures 4 and 5."),
    "win_rate_map": (
        "Win rates",
        win_rate_map,
        "As the paper's figures 6 and 7, which clip the colours to 0.25-0.45.",
    ),
    "variance_map": ("Variance over seeds", variance_map, "As the paper's figures 8 and 9."),
    "ratings_over_time": (
        "Ratings with intervals",
        ratings_over_time,
        "Order-free ratings beside Elo, whose spread comes from the order of the fights alone.",
    ),
    "finals": ("Final policies", finals, "Where the last policies and the scripted pilots stand."),
    "score_map": ("Everyone against everyone", score_map, "The whole tournament."),
    "forgetting_profile": (
        "Forgetting",
        forgetting_profile,
        "Whether later policies still beat earlier opponents.",
    ),
    "cyclic_discs": ("Cyclic part", cyclic_discs, "What no rating can show: who suits whom."),
    "outcomes_over_time": (
        "How fights end",
        outcomes_over_time,
        "The causes behind wins and losses.",
    ),
}


# Of a title, a study and what the result says: the page of its fights, or None (`watch.pairs`).
Fights = Callable[[str, Study, Mapping[str, Any]], str | None]


def report(word: str, out: Path | None = None, fights: Fights = lambda *_: None) -> int:
    """Report on the tournament that `word` names, into its folder unless `out` says where; returns
    0.

    `fights` makes the page that a click on the win-rate map opens.
    """
    path = find_tournament(word)
    folder = path if path.is_dir() else path.parent
    about = load_about(path)
    result, compared = as_compared(load_result(path), about)
    notes = [str(line) for key in ("missing", "notices") for line in about.get(key, ())]
    title = f"Tournament {folder.resolve().name}"
    entrants = len(result.defenders) + len(result.attackers)
    print(f"rating and drawing {entrants} entrants ...", flush=True)
    flown = load_flights(folder)
    files = write_report(
        result,
        out or folder / "report",
        title,
        notes,
        every=compared.every,
        flown=flown,
        fights=lambda study: fights(title, study, about),
    )
    print(f"written to {files[0]} and {len(files) - 1} files beside it")
    return 0


def write_report(
    result: TournamentResult,
    out: Path,
    title: str,
    notes: Sequence[str] = (),
    effort: Effort | None = None,
    every: int = EVERY,
    flown: Sequence[Flown] = (),
    fights: Callable[[Study], str | None] = lambda _: None,
) -> list[Path]:
    """Write everything under `out` and return the files, the page first. UserError 73 where that
    cannot be.

    `notes`: what the tournament itself says to be missing; `every`: as in `panel.away_panel`;
    `flown`: recorded fights, if there are any; `fights`: makes the page of fights to look at.
    """
    studied = study(result, effort)
    for folder in (out, out / "tables"):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(folder, error) from None
    written, pictures = [], []
    figures = dict(FIGURES)
    if flown:
        figures["flight_over_time"] = (
            "How they fly",
            lambda _: flight_over_time(flown),
            "Behaviour beside outcomes.",
        )
    if protocol := write_protocol(studied, out / "tables", every):
        figures["paper_protocol"] = (
            "The paper's protocol",
            lambda _: protocol_figure(protocol),
            "What rating each method in pools of its own can show, whatever the defenders are.",
        )
    clickable, gap = _fights(fights, studied, out)
    written += clickable
    for name, (heading, draw, about) in figures.items():
        path = out / "figures" / f"{name}.png"
        figure = draw(studied)
        save_figure(figure, path)
        picture = Picture(name, heading, about, path.read_bytes())
        if name == "win_rate_map" and clickable:
            picture = with_links(picture, areas(figure))
        pictures.append(picture)
        written += [path, path.with_suffix(".pdf")]
    made = (*tables(studied), *([flight_table(flown)] if flown else []))
    for table in made:
        for suffix, text in ((".csv", to_csv(table)), (".json", to_json(records(table)))):
            written.append(out / "tables" / (table.name + suffix))
            write_atomic(written[-1], text)
    written.append(out / "tables" / "scores.csv")
    write_atomic(written[-1], score_matrix(studied))
    verdict, gaps = _verdict(result, studied, out, every)
    claims, files = write_claims(studied, out / "tables", every)
    written += files
    known = [*notes, *studied.missing, *gaps, *gap]
    html = page(title, _summary(result), verdict, known, pictures, made, claims)
    write_atomic(out / "report.html", html)
    return [out / "report.html", *written]


def _fights(
    make: Callable[[Study], str | None], studied: Study, out: Path
) -> tuple[list[Path], list[str]]:
    """The page of fights, and what keeps it from being made."""
    try:
        text = make(studied)
    except UserError as error:
        reason = one_line(error.message.splitlines()[0])
        return [], [f"No cell of the win-rate map can be clicked: {reason}."]
    if text is None:
        return [], []
    write_atomic(out / FIGHTS_NAME, text)
    return [out / FIGHTS_NAME], []


def _verdict(
    result: TournamentResult, studied: Study, out: Path, every: int
) -> tuple[tuple[list[str], str], list[str]]:
    """The comparison of methods in sentences and numbers, or what keeps it from being made."""
    if len(studied.methods) < 2:
        return ([], ""), []
    try:
        verdict = judge(result, every=every)
    except UserError as error:
        return ([], ""), [f"No comparison of methods: {error.message}."]
    write_atomic(out / "tables" / "comparison.json", to_json(verdict_json(verdict)))
    cells = [map_tests.summary(map_test) for map_test in map_tests.map_tests(studied.win_maps)]
    return (
        [answer.sentence for answer in verdict.answers],
        "\n\n".join([verdict_text(verdict), *cells]),
    ), []


def _summary(result: TournamentResult) -> list[str]:
    defenders, attackers = result.played.shape
    fights = int(result.played.sum()) * result.cause.shape[2]
    seeds = "; ".join(
        f"{method}: {count} training seeds" for method, count in seeds_of(result).items()
    )
    return [
        f"{fights:,} fights: {defenders} defenders against {attackers} attackers, {result.cause.shape[2]} fights a cell, "
        f"each from the same start states. {seeds or 'No trained entrants'}.",
        "Ratings of two tournaments cannot be compared. Every rating states its gauge; ties count as half a win.",
    ]
