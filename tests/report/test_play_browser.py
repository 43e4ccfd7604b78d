"""The play page in a browser: keys, mouse, fingers and a gamepad fly; fights end; it is quiet."""

import io
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser import Tab, chromium
from PIL import Image
from policies import make_policy

from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.report.play_data import Opponent, game_data, opponent_data
from dronecombat_jax.report.play_page import page
from dronecombat_jax.sim.scene import load_scene

pytestmark = pytest.mark.tour
HOSTILE = "</script><script>alert(1)</script>"
WIDE, PHONE = (820, 560), (390, 844)  # small pictures: software draws them


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Addresses of pages: against hover, against dash, and against a policy on either side."""
    folder, config = tmp_path_factory.mktemp("pages"), Config()
    game = game_data(config, load_scene(config.sim))
    policy = opponent_data(Opponent(HOSTILE, make_policy(), LearnConfig()))
    scripted = lambda name: opponent_data(Opponent(name, name, LearnConfig()))
    both = {
        "hover": (1, [scripted("hover"), None]),
        "dash": (0, [None, scripted("dash")]),
        "policy": (1, [policy, policy]),
    }
    for name, (side, opponents) in both.items():
        data = {"title": HOSTILE, "side": side, "opponents": opponents, "game": game}
        (folder / f"{name}.html").write_text(page(data))
    return {path.stem: path.as_uri() for path in folder.iterdir()}


class Game(Tab):
    """A page on which somebody flies; `it` in JavaScript is the page."""

    def ask(self, body: str, argument: Any = None) -> Any:
        it = "const it = document.querySelector('#play').play;"
        return self.page.evaluate(f"(given) => {{ {it} {body} }}", argument)

    def phase(self) -> str:
        return self.ask("return it.session.phase")

    def until(self, happened: Callable[[], Any], seconds: float = 90.0) -> None:
        deadline = time.monotonic() + seconds
        while not happened():
            assert time.monotonic() < deadline, self.phase()
            time.sleep(0.05)

    def start(self, speed: float = 1.0) -> None:
        """Wait until the count is over; `speed`: of real time."""
        self.page.keyboard.press("Enter")
        self.ask("it.acts.speed(given)", speed)
        self.until(lambda: self.phase() != "counting")

    def place(self, role: int) -> np.ndarray:
        return np.array(self.ask("return it.session.state.drones[given].position", role))

    def steps(self, count: int) -> None:
        """Let at least so many control steps pass, or the fight end."""
        last = count + self.ask("return it.session.state.clock")
        over = "return it.session.state.clock >= given || it.session.phase === 'over'"
        self.until(lambda: self.ask(over, last))

    def picture(self) -> np.ndarray:
        with Image.open(io.BytesIO(self.page.screenshot())) as image:
            return np.asarray(image.convert("RGB"), int)


def test_a_flight_by_hand_reaches_the_target_and_the_next_begins(
    browser: Any, pages: dict[str, str]
):
    tab = Game(browser, pages["hover"], WIDE)
    banner = tab.page.locator(".banner")
    assert "Reach the target" in banner.inner_text() and tab.phase() == "ready"
    tab.ask("it.session.state.target[2] = it.session.state.drones[1].position[2]")
    before, first = tab.picture(), tab.place(1)
    tab.start()
    tab.page.keyboard.down("w")
    tab.steps(30)
    ahead = tab.place(1) - first
    assert ahead[0] > 0.3 and ahead[1] > 0.3  # the target lies at (5, 5)
    assert (np.abs(tab.picture() - before).sum(axis=2) > 60).sum() > 2000
    tab.until(lambda: tab.phase() == "over")
    tab.page.keyboard.up("w")
    assert "You win" in banner.inner_text()
    assert "Attacker wins: it reaches the target after" in banner.inner_text()
    assert tab.page.locator(".score").inner_text() == "You 1 : 0"
    tab.page.keyboard.press("r")
    assert tab.phase() == "counting" and banner.inner_text().strip() in "321"
    assert np.linalg.norm(tab.place(1)[:2]) < 1e-6 and tab.ask("return it.session.state.clock") == 0
    tab.close()


def test_keys_climb_sink_brake_and_pause(browser: Any, pages: dict[str, str]):
    tab = Game(browser, pages["hover"], WIDE)
    tab.start()
    height = tab.place(1)[2]
    tab.page.keyboard.down(" ")
    tab.steps(25)
    tab.page.keyboard.up(" ")
    risen = tab.place(1)[2]
    assert risen > height + 0.1
    tab.page.keyboard.down("Shift")
    tab.steps(40)
    tab.page.keyboard.up("Shift")
    assert tab.place(1)[2] < risen + 0.5
    tab.page.keyboard.down("ArrowLeft")
    tab.steps(25)
    tab.page.keyboard.up("ArrowLeft")
    x, y, _ = tab.place(1)
    assert x < -0.05 and y > 0.05  # left of the way to (5, 5)
    tab.steps(60)
    assert tab.ask("return Math.hypot(...it.session.state.drones[1].velocity)") < 0.4
    tab.page.keyboard.press("Escape")
    assert tab.phase() == "paused" and "Paused" in tab.page.locator(".banner").inner_text()
    clock = tab.ask("return it.session.state.clock")
    tab.settle()
    assert tab.ask("return it.session.state.clock") == clock
    tab.page.keyboard.press("p")
    assert tab.phase() == "flying"
    tab.close()


def test_a_fight_that_is_lost_says_why(browser: Any, pages: dict[str, str]):
    tab = Game(browser, pages["dash"], WIDE)
    assert "Defend the target" in tab.page.locator(".banner").inner_text()
    tab.start()
    tab.until(lambda: tab.phase() == "over")
    text = tab.page.locator(".banner").inner_text()
    assert "You lose" in text and "Attacker wins: it reaches the target after" in text
    assert tab.page.locator(".score").inner_text() == "You 0 : 1"
    tab.page.locator(".banner button").click()
    assert tab.phase() == "counting"
    tab.close()


def test_never_faster_than_real_time_and_not_in_the_background(browser: Any, pages: dict[str, str]):
    tab = Game(browser, pages["hover"], WIDE)
    tab.start()
    clock = lambda: tab.ask("return it.session.state.clock")
    # between two pictures: 1 s has passed, of which at most 0.1 s are flown, at half speed
    flown = tab.ask("it.acts.speed(1 / 2); const from = it.session.state.clock; it.session.pass(1); "
                    "return it.session.state.clock - from")  # fmt: skip
    assert flown <= 3
    for _ in range(5):
        tab.page.keyboard.press("+")
    assert tab.ask("return it.session.speed") == 1.0
    tab.ask("Object.defineProperty(document, 'hidden', { get: () => true });"
            "document.dispatchEvent(new Event('visibilitychange'))")  # fmt: skip
    assert tab.phase() == "paused"
    stopped = clock()
    time.sleep(0.3)
    assert clock() == stopped
    tab.close()


def test_the_mouse_is_a_stick(browser: Any, pages: dict[str, str]):
    tab = Game(browser, pages["hover"], WIDE)
    tab.start(1 / 4)  # the target is not reached before the mouse is up
    tab.page.mouse.move(300, 400)
    tab.page.mouse.down()
    tab.page.mouse.move(300, 330, steps=3)
    assert tab.ask("return it.pad.read()") == pytest.approx({"right": 0, "forward": 1, "up": 0})
    assert tab.page.locator(".stick.move").is_visible()
    tab.steps(20)
    assert tab.place(1)[0] > 0.03
    tab.page.mouse.up()
    assert tab.ask("return it.pad.read().forward") == 0
    tab.page.mouse.wheel(0, -120)
    assert tab.ask("return it.pad.wheel.up") == 1
    tab.close()


def test_two_fingers_on_a_phone(browser: Any, pages: dict[str, str]):
    tab = Game(browser, pages["policy"], PHONE, has_touch=True, is_mobile=True)
    assert tab.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    for part in tab.page.locator(".play button:visible, .number:visible").all():
        box = part.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= PHONE[0]
        assert box["y"] + box["height"] <= PHONE[1]
    tab.page.locator(".banner button").tap()
    tab.until(lambda: tab.phase() == "flying")
    touch = tab.context.new_cdp_session(tab.page)
    for kind, y in (("touchStart", 450), ("touchMove", 400)):
        points = [{"x": 80, "y": y, "id": 1}, {"x": 330, "y": y, "id": 2}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    wish = tab.ask("return it.pad.read()")
    assert wish["forward"] > 0.5 and wish["up"] > 0.5 and abs(wish["right"]) < 1e-6
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert tab.ask("return it.pad.read().up") == 0
    tab.close()


def test_a_gamepad(browser: Any, pages: dict[str, str]):
    script = """
    globalThis.padNow = { connected: true, axes: [0, 0, 0, 0],
      buttons: Array.from({ length: 16 }, () => ({ pressed: false, value: 0 })) };
    navigator.getGamepads = () => [null, globalThis.padNow];
    """
    tab = Game(browser, pages["hover"], WIDE, script=script)
    press = lambda on: tab.ask("padNow.buttons[0] = { pressed: given, value: +given }", on)
    press(True)
    tab.until(lambda: tab.phase() == "flying")
    press(False)
    tab.ask("padNow.axes = [0.1, -0.9, 0, 0]; padNow.buttons[7].value = 0.5")
    assert tab.ask("return it.pad.read()") == pytest.approx({"right": 0, "forward": 0.9, "up": 0.5})
    tab.steps(20)
    assert tab.place(1)[0] > 0.02
    press(True)
    tab.until(lambda: tab.phase() == "paused")
    tab.close()


def test_a_policy_can_be_met_on_either_side_and_its_name_is_harmless(
    browser: Any, pages: dict[str, str]
):
    tab = Game(browser, pages["policy"], WIDE, color_scheme="dark")
    assert tab.page.locator("h1").inner_text() == f"Fly against {HOSTILE}"
    assert tab.picture().mean() < 70
    tab.page.get_by_role("button", name="Defend", exact=True).click()
    assert tab.ask("return it.session.person") == 0 and tab.phase() == "ready"
    assert "You fly the defender" in tab.page.locator(".about").inner_text()
    tab.page.keyboard.press("c")
    assert tab.page.get_by_role("button", name="Fixed").get_attribute("aria-pressed") == "true"
    tab.page.keyboard.press("t")
    tab.settle()
    assert tab.picture().mean() > 150
    tab.start(1 / 8)
    tab.steps(2)
    action = tab.ask("return it.session.actions[1]")
    assert action != [-1, 0, 0, 0] and max(map(abs, action)) > 0.0
    tab.page.keyboard.press("?")
    assert tab.phase() == "paused" and "How to fly" in tab.page.locator("dialog").inner_text()
    tab.close()


def test_without_webgl_a_sentence_says_so(browser: Any, pages: dict[str, str]):
    script = "HTMLCanvasElement.prototype.getContext = () => null"
    tab = Game(browser, pages["hover"], WIDE, script=script)
    assert "no WebGL" in tab.page.get_by_role("alert").inner_text()
    tab.page.keyboard.press("Enter")
    assert tab.phase() == "ready"
    tab.close()


def test_a_place_that_runs_no_scripts_says_so(browser: Any, pages: dict[str, str]):
    tab = Game(browser, pages["hover"], WIDE, java_script_enabled=False)
    assert "runs no scripts" in tab.page.locator("#play").inner_text()
    tab.close()
