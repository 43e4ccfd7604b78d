"""Tables, the page and the whole report of a tournament."""

import csv
import io
import json
import re

import numpy as np
import pytest
from planted import planted
from tournaments import build, entrants

from dronecombat_jax.analysis.study import Effort, study
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.files.plain import Table, records, to_csv, to_json
from dronecombat_jax.report.page import Picture, page
from dronecombat_jax.report.tables import tables
from dronecombat_jax.report.tournament_report import FIGURES, write_report
from dronecombat_jax.types import Cause

QUICK = Effort(orders=2, bootstrap=10, value_samples=2)
BAD = ["=1+1", "+x", "-x", "@x", "a\nb", '"quoted", <b>&', "ü" * 300]


def test_hostile_names_neither_break_a_csv_nor_start_a_formula():
    rows = tuple((name, -1.5, float("nan"), float("inf")) for name in BAD)
    read = list(csv.reader(io.StringIO(to_csv(Table("t", "", ("name", "a", "b", "c"), rows)))))
    assert [row[0] for row in read[1:]] == [
        "'=1+1",
        "'+x",
        "'-x",
        "'@x",
        "a?b",
        '"quoted", <b>&',
        "ü" * 300,
    ]
    assert all(row[1:] == ["-1.5", "", "inf"] for row in read[1:])


def test_json_is_plain():
    told = json.loads(
        to_json(records(Table("t", "about", ("a", "b"), ((float("inf"), np.float64("nan")),))))
    )
    assert told == {"about": "about", "rows": [{"a": None, "b": None}]}


def test_ratings_count_an_attackers_wins_as_the_defenders_losses():
    """By hand: the defender beats the first attacker twice, and ties with the second and loses to it."""
    cause = np.asarray(
        [[[Cause.INTERCEPT, Cause.INTERCEPT], [Cause.TIMEOUT, Cause.REACHED]]], np.int8
    )
    told = study(build(cause, entrants("d", 1, 1), entrants("a", 1, 2)), QUICK)
    rows = records(tables(told)[0])["rows"]
    assert [
        (row["role"], row["wins"], row["draws"], row["losses"], row["mean_score"]) for row in rows
    ] == [
        ("defender", 2, 1, 1, 0.625),
        ("attacker", 0, 0, 2, 0.0),
        ("attacker", 1, 1, 0, 0.75),
    ]
    assert rows[1]["interval"] == "open below"


def test_the_page_escapes_what_is_foreign_and_asks_nobody():
    table = Table("t", "<i>", ("name", "value"), tuple((name, 1.0) for name in BAD))
    html = page(
        "<script>",
        BAD,
        (["<b>"], "<pre>"),
        ["</style>"],
        [Picture("p", "<h>", "&", b"png")],
        [table],
    )
    assert (
        "<script" not in html
        and "<i>" not in html
        and "<b>" not in html
        and html.count("</style>") == 1
    )
    assert set(re.findall(r'(?:src|href)="([^"]{5})', html)) <= {"data:", "#p"}
    assert "http:" not in html and "https:" not in html and "default-src 'none'" in html


@pytest.mark.long
def test_the_whole_report(tmp_path):
    files = write_report(planted(2, 3, 4), tmp_path / "report", "planted", ["skipped: one"], QUICK)
    assert files[0] == tmp_path / "report" / "report.html"
    assert all(path.stat().st_size for path in files)
    names = {path.relative_to(tmp_path / "report").as_posix() for path in files}
    assert {f"figures/{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")} < names
    assert {
        f"tables/{name}.{kind}"
        for name in ("ratings", "win_rates", "endings")
        for kind in ("csv", "json")
    } < names
    html = files[0].read_text()
    assert html.count('src="data:image/png;base64,') == len(FIGURES) + 1  # the paper's protocol
    assert "UNDECIDED" in html and "skipped: one" in html
    assert json.loads((tmp_path / "report/tables/comparison.json").read_text())["comparisons"]


def test_nowhere_to_write(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot write") as raised:
        write_report(planted(1, 1, 1), tmp_path / "file", "nowhere", effort=QUICK)
    assert raised.value.exit_code == EXIT_CANNOT_WRITE


@pytest.mark.long
def test_the_papers_claims_are_on_the_page_and_in_files(tmp_path):
    write_report(planted(2, 4, 4), tmp_path, "planted", effort=QUICK, every=2)
    html = (tmp_path / "report.html").read_text()
    assert html.count("href='#claims'") == 1
    section = html.split("id='claims'")[1].split("</table>")[0]
    assert section.count("<tr>") == 7 and "IPPO&#x27;s attackers rate above" in section
    told = json.loads((tmp_path / "tables/claims.json").read_text())
    assert len(told) == 6 and {claim["verdict"] for claim in told} == {"undecided"}
    assert (tmp_path / "tables/claims.md").read_text().startswith("| claim | paper | ours |")
    examined = json.loads((tmp_path / "tables/paper_protocol.json").read_text())
    assert len(examined["pools"]) == 4 and (tmp_path / "figures/paper_protocol.png").stat().st_size


@pytest.mark.long
def test_a_tournament_of_other_methods_has_no_claims(tmp_path):
    sides = entrants("d", 1, 2, ("ippo", "else")), entrants("a", 1, 2, ("ippo", "else"))
    cause = np.full((4, 4, 1), Cause.TIMEOUT, np.int8)
    write_report(build(cause, *sides), tmp_path, "others", effort=QUICK)
    assert "id='claims'" not in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "tables/claims.json").exists()
    assert not (tmp_path / "tables/paper_protocol.json").exists()
