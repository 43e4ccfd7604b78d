"""The replay page in a browser: it draws, plays, obeys keys, mouse and fingers, and is quiet."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser import Tab, chromium
from duels import RULES, fights, two_against_two
from replay_tabs import HOSTILE, LOCATE, PHONE, WIDE, changed, picture

from dronecombat_jax.report.replay_data import Fight
from dronecombat_jax.watch.replay import Replay

pytestmark = pytest.mark.tour


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Addresses of pages: one fight, four with hostile names, an attacker alone, two cells, teams."""
    folder = tmp_path_factory.mktemp("pages")
    single, four = (Replay(name, "about", tuple(fights(count, 100, name)), RULES)
                 for name, count in (("one", 1), (HOSTILE, 4)))  # fmt: skip
    single.save(folder / "one.html")
    four.save(folder / "four.html")
    alone = Replay("alone", "", single.fights, RULES._replace(alone=True))
    alone.save(folder / "alone.html")
    team = Fight(two_against_two(), "Fight 1", ("both", "both"))
    Replay("teams", "", (team,), RULES).save(folder / "teams.html")
    cells = (
        f"<body style='margin: 0'>{single._repr_html_()}<p>between</p>{four._repr_html_()}</body>"
    )
    (folder / "cells.html").write_text(
        f"<!doctype html><meta charset=utf-8><link rel=icon href=data:,>{cells}"
    )
    return {path.stem: path.as_uri() for path in folder.iterdir()}


def test_drones_move_where_they_should_while_it_plays(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["one"], WIDE)
    tab.run("replay.clock.seek(0.5)")
    places = [tab.run(LOCATE, [0, drone, 0.5]) for drone in range(2)]
    before = [picture(tab, place) for place in places]
    assert all(image.std() > 12 for image in before)  # something is drawn there
    tab.page.keyboard.press(" ")
    tab.wait("return replay.clock.time > 1.2")
    tab.page.keyboard.press("k")
    time = tab.run("return replay.clock.time")
    assert not tab.run("return replay.clock.playing") and time < 2.0
    for drone, image in enumerate(before):
        assert changed(image, picture(tab, places[drone])) > 60
        assert changed(image, picture(tab, tab.run(LOCATE, [0, drone, time]))) > 60
    assert tab.run("return replay.clock.time") == time  # it is paused
    tab.close()


def test_keys_slider_and_buttons_move_the_time(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["one"], WIDE)
    at = lambda: tab.run("return replay.clock.time")
    for key, time in (
        ("End", 2.0),
        ("ArrowLeft", 1.98),
        ("Shift+ArrowLeft", 1.78),
        ("ArrowRight", 1.8),
        ("Home", 0.0),
    ):
        tab.page.keyboard.press(key)
        assert at() == pytest.approx(time), key
    box = tab.page.locator("input[type=range]").bounding_box()
    middle = box["y"] + box["height"] / 2
    tab.page.mouse.move(box["x"] + 10, middle)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + box["width"] / 2, middle, steps=4)
    assert at() == pytest.approx(1.2, abs=0.05)  # half of the fight's 2 s and the 0.4 s after it
    tab.page.mouse.up()
    tab.page.keyboard.press("ArrowRight")
    assert at() == pytest.approx(1.22, abs=0.05)
    tab.page.get_by_label("A step back").click()
    tab.page.get_by_label("Speed").select_option("2")
    assert at() == pytest.approx(1.2, abs=0.05) and tab.run("return replay.clock.speed") == 2
    tab.close()


def test_read_outs_are_the_numbers_of_the_fight(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["one"], WIDE)
    flown = fights(1)[0].trajectory
    tab.run("replay.clock.seek(1.0)")
    tab.settle()
    numbers = tab.page.locator(".readouts .number").all_inner_texts()
    speeds = [np.linalg.norm(flown.qvel[50, [0, 1, 2]]), np.linalg.norm(flown.qvel[50, [6, 7, 8]])]
    heights, thrust = flown.qpos[50, [2, 9]], 0.5256 * (flown.action[50, :, 0] + 1) / 2
    apart = np.linalg.norm(flown.qpos[50, :3] - flown.qpos[50, 7:10])
    to_target = np.linalg.norm(flown.qpos[50, 7:10] - flown.target)
    drones = [f"{value:.{digits}f}" for drone in range(2)
              for value, digits in ((speeds[drone], 1), (heights[drone], 2), (thrust[drone], 2))]  # fmt: skip
    assert numbers[:6] == drones
    assert (numbers[6], numbers[8]) == (f"{apart:.2f}", f"{to_target:.2f}")
    tab.page.keyboard.press("End")
    tab.settle()
    assert (
        tab.page.locator(".verdict").inner_text()
        == "Defender wins: it intercepts the attacker after 2.00\u00a0s"
    )
    tab.close()


def test_a_fight_of_many_is_enlarged_and_followed(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["four"], WIDE)
    assert (
        tab.page.locator(".tile:visible").count() == 4
        and tab.run("return document.querySelectorAll('*').length") < 20
    )
    assert tab.page.locator("h1").inner_text() == HOSTILE
    tab.page.locator(".tile").nth(2).click(position={"x": 100, "y": 90})
    assert (
        tab.page.locator(".tile:visible").count() == 1
        and "3 of 4" in tab.page.locator(".place").inner_text()
    )
    tab.page.keyboard.press("a")
    tab.settle()
    frame = tab.page.locator("canvas").bounding_box()
    centre = (frame["x"] + frame["width"] / 2, frame["y"] + frame["height"] / 2)
    assert tab.run(LOCATE, [2, 1, 0.0]) == pytest.approx(centre, abs=1.0)  # the attacker
    tab.page.keyboard.press("n")
    assert "4 of 4" in tab.page.locator(".place").inner_text()
    tab.page.keyboard.press("Escape")
    assert tab.page.locator(".tile:visible").count() == 4
    tab.close()


def test_a_followed_drone_hides_what_is_behind_it(browser: Any, pages: dict[str, str]):
    """From behind, its canopy is 6 cm above its centre: 16 pixels, at 3.1 m; the sky is blue, it is
    orange.
    """
    tab = Tab(browser, pages["one"], WIDE)
    tab.page.keyboard.press("a")
    tab.settle()
    x, y = tab.run(LOCATE, [0, 1, 0.0])
    red, _, blue = picture(tab, (x, y - 14), half=3).mean(axis=(0, 1))
    assert red > blue + 80
    tab.close()


def test_the_mouse_turns_and_zooms_the_view(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["one"], WIDE)
    view = lambda: tab.run(
        "const { yaw, pitch, zoom } = replay.stage.rig.view; return [yaw, pitch, zoom]"
    )
    first, before = view(), picture(tab)
    tab.page.mouse.move(400, 300)
    tab.page.mouse.down()
    tab.page.mouse.move(500, 340, steps=3)
    tab.page.mouse.up()
    tab.page.mouse.wheel(0, -300)
    tab.settle()
    yaw, pitch, zoom = view()
    assert (
        yaw < first[0]
        and pitch > first[1]
        and zoom < first[2]
        and changed(before, picture(tab)) > 5000
    )
    tab.page.keyboard.press("0")
    assert view() == first
    tab.close()


def test_dark_and_light(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["one"], WIDE, color_scheme="dark")
    assert picture(tab).mean() < 60
    tab.page.keyboard.press("t")
    assert picture(tab).mean() > 180
    tab.close()


def test_fingers_and_a_narrow_screen(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["four"], PHONE, has_touch=True, is_mobile=True)
    assert tab.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    tab.page.touchscreen.tap(100, 160)
    assert "1 of 4" in tab.page.locator(".place").inner_text()
    for part in tab.page.locator(
        ".replay button:visible, .replay select:visible, .number:visible"
    ).all():
        box = part.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= PHONE[0]
    yaw = tab.run("return replay.stage.rig.view.yaw")
    touch = tab.context.new_cdp_session(tab.page)
    for kind, x in (
        ("touchStart", 120),
        ("touchMove", 150),
        ("touchMove", 190),
        ("touchEnd", None),
    ):
        points = [] if x is None else [{"x": x, "y": 180}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert tab.run("return replay.stage.rig.view.yaw") < yaw - 0.2
    place = tab.run(LOCATE, [0, 1, 0.0])
    assert picture(tab, place).std() > 12
    tab.close()


def test_without_webgl_a_sentence_says_so_and_the_numbers_are_there(
    browser: Any, pages: dict[str, str]
):
    tab = Tab(
        browser, pages["four"], WIDE, script="HTMLCanvasElement.prototype.getContext = () => null"
    )
    assert "no WebGL" in tab.page.get_by_role("alert").inner_text()
    results = tab.page.locator(".results li")
    assert results.count() == 4 and "Defender wins" in results.nth(1).inner_text()
    results.nth(1).get_by_role("button").click()
    assert "2 of 4" in tab.page.locator(".place").inner_text()
    tab.close()


def test_two_cells_of_a_notebook_do_not_meet(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["cells"], (900, 1400))
    hosts = "[...document.querySelectorAll('[id^=dronecombat-replay]')]"
    assert tab.page.evaluate(f"{hosts}.length") == 2 and tab.page.locator("canvas").count() == 2
    tab.page.evaluate(f"{hosts}[0].replay.clock.seek(0.5)")
    assert tab.page.evaluate(f"{hosts}.map((host) => host.replay.clock.time)") == [0.5, 0]
    for index in range(2):
        box = tab.page.locator("canvas").nth(index).bounding_box()
        centre = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        assert picture(tab, centre, half=80).std() > 8
    tab.page.keyboard.press("Home")  # nobody has the focus: the notebook's key
    assert tab.page.evaluate(f"{hosts}[0].replay.clock.time") == 0.5
    tab.close()


def test_an_attacker_that_flies_alone(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["alone"], WIDE)
    tab.run("replay.clock.seek(1.0)")
    tab.settle()
    assert not tab.page.get_by_role("button", name="Defender", exact=True).is_visible()
    assert not tab.page.locator("section.defender").is_visible()
    assert tab.page.locator(".between .number").first.inner_text() == "\u2013"  # nobody is apart
    tab.page.keyboard.press("d")
    assert tab.run("return replay.stage.rig.followed") is None  # there is no defender to follow
    assert picture(tab, tab.run(LOCATE, [0, 1, 1.0])).std() > 12
    tab.close()


def test_teams(browser: Any, pages: dict[str, str]):
    """Drone by drone, numbers and who is down; attacker 2 (drone 3) was struck after 0.8 s."""
    tab = Tab(browser, pages["teams"], WIDE)
    tab.run("replay.clock.seek(1.0)")
    tab.settle()
    places, target = two_against_two().qpos[50].reshape(4, 7)[:, :3], np.array([5.0, 5.0, 1.0])
    speeds = np.linalg.norm(two_against_two().qvel[50].reshape(4, 6)[:, :3], axis=1)
    lines = tab.page.locator(".team tbody tr").all_inner_texts()
    assert [line.split("\t") for line in lines] == [
        ["Defender 1", f"{speeds[0]:.1f}", "1.00"],
        ["Defender 2", "0.0", "1.00"],
        ["Attacker 1", f"{speeds[2]:.1f}", "1.00"],
        ["Attacker 2", "down", "1.00"],
    ]
    apart, _, away = tab.page.locator(".between .number").all_inner_texts()
    nearest = np.linalg.norm(places[:2] - places[2], axis=1).min()  # attacker 2 does not count
    assert (apart, away) == (f"{nearest:.2f}", f"{np.linalg.norm(places[2] - target):.2f}")
    texts = tab.page.locator(".events li span").all_inner_texts()
    assert texts[0] == "Defender 2 strikes attacker 2" and len(texts) == 3
    assert all(picture(tab, tab.run(LOCATE, [0, drone, 1.0])).std() > 12 for drone in range(4))
    followed = []
    for key in "ddda":  # attacker 2 is down, so that there is one to follow
        tab.page.keyboard.press(key)
        followed.append(tab.run("return replay.stage.rig.followed"))
    assert followed == [0, 1, 0, 2]
    tab.page.get_by_role("button", name="Attacker 2", exact=True).click()
    assert tab.run("return replay.stage.rig.followed") == 3
    tab.close()


def test_a_place_that_runs_no_scripts_says_so(browser: Any, pages: dict[str, str]):
    tab = Tab(browser, pages["one"], WIDE, java_script_enabled=False)
    assert "runs no scripts" in tab.page.locator("#replay").inner_text()
    tab.close()
