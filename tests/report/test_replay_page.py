"""The page and the notebook cell as text: whole, small, harmless, and asking nobody."""

import html
import json
import re
from html.parser import HTMLParser

import pytest
from duels import RULES, fights

from dronecombat_jax.report.replay_data import Fight, replay_data
from dronecombat_jax.report.replay_page import cell, page, script
from dronecombat_jax.watch.replay import Replay

HOSTILE = "</script><script>alert(1)</script><!-- <b>&'\"\u2028"


def replay(count: int = 1, steps: int = 100, title: str = "title") -> Replay:
    return Replay(title, title, tuple(fights(count, steps)), RULES)


class Elements(HTMLParser):
    """Tags in order, with their attributes."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.append((tag, dict(attrs)))


def data_in(text: str) -> dict:
    """What a page hands to its script."""
    (call,) = re.findall(
        r'^dronecombatReplay\("[^"]+", (.*), \{"embedded": \w+\}\);', text, re.MULTILINE
    )
    return json.loads(call)


def test_sixteen_fights_of_full_length_fit_into_one_and_a_half_megabytes():
    assert len(replay(16, 500).page().encode()) < 1_500_000


def test_the_same_fights_make_the_same_page():
    assert replay(2).page() == replay(2).page()


def test_names_are_harmless_and_arrive_as_they_are():
    fight = fights(1)[0]._replace(name=HOSTILE, pilots=(HOSTILE, HOSTILE), note=HOSTILE)
    shown = Replay(HOSTILE, HOSTILE, (Fight(*fight),), RULES)
    for text in (shown.page(), shown._repr_html_()):
        assert [tag for tag, _ in Elements(text).tags].count("script") == 1
        assert data_in(text)["title"] == HOSTILE
        assert data_in(text)["fights"][0]["name"] == HOSTILE.replace("\u2028", "?")
    assert html.escape(HOSTILE) in shown.page()


def test_nothing_is_asked_for():
    text = replay().page()
    policy = next(attrs["content"] for tag, attrs in Elements(text).tags if attrs.get("http-equiv"))
    assert "default-src 'none'" in policy and "connect-src" not in policy
    named = [
        value
        for _, attrs in Elements(text).tags
        for name, value in attrs.items()
        if name in ("src", "href")
    ]
    assert named == ["data:,"]
    assert not re.search(r"\bimport\s*\(|importScripts|new Worker|eval\(", script())


def test_the_script_cannot_end_its_own_element():
    assert "</script" not in script().lower() and "<!--" not in script()


def test_a_cell_is_a_div_and_a_classic_script_and_every_cell_has_its_own():
    shown = replay()
    texts = [shown._repr_html_(), shown._repr_html_()]
    names = []
    for text in texts:
        tags = Elements(text).tags
        assert [tag for tag, _ in tags] == ["div", "p", "script"] and tags[2][1] == {}
        names.append(tags[0][1]["id"])
    assert names[0] != names[1]
    assert "runs no scripts" in texts[0]


def test_the_height_of_a_cell():
    assert "height: 300px" in cell(replay_data("", "", fights(1), RULES), "one", height=300)


def test_the_page_is_saved_whole_or_not_at_all(tmp_path):
    path = replay().save(tmp_path / "new" / "fight.html")
    assert path.read_text() == replay().page() == page(data_in(path.read_text()))
    with pytest.raises(Exception, match="cannot write"):
        replay().save(path / "below.html")
    assert [file.name for file in path.parent.iterdir()] == ["fight.html"]
