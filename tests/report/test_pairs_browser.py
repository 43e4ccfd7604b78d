"""The page of a tournament's pairs in a browser: cells, keys, addresses, a fight that plays."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Tab, chromium
from duels import RULES, fights

from dronecombat_jax.report.map_panels import Panel
from dronecombat_jax.report.pairs_page import PairsMap, pairs_data
from dronecombat_jax.report.replay_page import pairs_page

pytestmark = pytest.mark.tour
HOSTILE = "</script><script>alert(1)</script>"
CELLS = "[...replay.maps[0].box.querySelectorAll('button')]"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Two defenders and three attackers, of which one pair has no fight."""
    numbers = np.asarray([[0, 1, -1], [2, 3, 4]])
    values = np.asarray([[0.1, 0.5, np.nan], [0.2, 0.9, 0.4]])
    panel = Panel(HOSTILE, ("run#0",), 1, np.arange(2), np.arange(3), values)
    shown = PairsMap(panel, HOSTILE, (["1 M", HOSTILE], ["1 M", "2 M", "3 M"]), numbers)
    path = tmp_path_factory.mktemp("pairs") / "fights.html"
    path.write_text(pairs_page(pairs_data(HOSTILE, "about", [shown], fights(5), RULES)))
    return path.as_uri()


def said(tab: Tab) -> str:
    return tab.run("return replay.said.textContent")


@pytest.mark.parametrize("size", [(1280, 900), (390, 844)], ids=["wide", "phone"])
def test_a_click_plays_the_fight_of_that_cell(browser: Any, address: str, size, tmp_path: Path):
    tab = Tab(browser, address, size)
    assert "defends against 3 M" in said(tab) and "wins 0.40" in said(tab)  # the last pair
    tab.run(f"{CELLS}.find((cell) => cell.dataset.place === '0-0-1').click()")
    tab.wait("return replay.said.textContent.includes('1 M defends against 2 M')")
    assert tab.run("return replay.page.flights[0].name") == "Fight 2"
    tab.run("replay.page.acts.play()")
    tab.wait("return replay.page.clock.time > 0.2")
    assert tab.run("return location.hash") == "#0-0-1"
    assert tab.run("return document.documentElement.scrollWidth <= innerWidth")
    tab.close()


def test_an_address_names_a_cell_and_a_wrong_one_does_no_harm(browser: Any, address: str):
    for name, text in (("#0-0-0", "1 M defends against 1 M"), ("#0-0-2", "3 M"), ("#x", "3 M")):
        tab = Tab(browser, address + name, (1280, 900))
        assert text in said(tab)
        tab.close()


def test_arrow_keys_walk_from_cell_to_cell_and_enter_chooses(browser: Any, address: str):
    tab = Tab(browser, address, (1280, 900))
    tab.run("replay.chosen.focus()")
    for key in ("ArrowLeft", "ArrowDown", "Enter"):
        tab.page.keyboard.press(key)
    tab.wait("return replay.said.textContent.includes('1 M defends against 2 M')")
    assert tab.run("return location.hash") == "#0-0-1"
    tab.close()


def test_a_pair_without_a_fight_cannot_be_chosen(browser: Any, address: str):
    tab = Tab(browser, address, (1280, 900))
    off = tab.run(
        f"return {CELLS}.filter((cell) => cell.disabled).map((cell) => cell.dataset.place)"
    )
    assert off == ["0-0-2"]
    tab.close()
