"""What tests of the replay page in a browser look at: places on the screen, pictures."""

import io

import numpy as np
from browser import Tab
from PIL import Image

HOSTILE = "</script><script>alert(1)</script>"
WIDE, PHONE = (1280, 800), (390, 844)
# Where a drone of a fight is on the screen, in CSS pixels of the window.
LOCATE = """
const [fight, drone, time] = it;
const view = replay.tiles.views(replay.canvas).find(({ index }) => index === fight);
const camera = replay.stage.cameraFor(fight, time, view.width / view.height);
const point = replay.flights[fight].position(drone, time);
const place = camera.position.clone().fromArray(point).project(camera);
const frame = replay.canvas.getBoundingClientRect();
return [frame.left + view.left + (0.5 + place.x / 2) * view.width,
  frame.top + view.top + (0.5 - place.y / 2) * view.height];
"""


def picture(tab: Tab, centre: tuple[float, float] | None = None, half: int = 24) -> np.ndarray:
    """A screenshot [H, W, 3], whole or around a point."""
    tab.settle()
    clip = centre and {
        "x": centre[0] - half,
        "y": centre[1] - half,
        "width": 2 * half,
        "height": 2 * half,
    }
    with Image.open(io.BytesIO(tab.page.screenshot(clip=clip or None))) as image:
        return np.asarray(image.convert("RGB"), int)


def changed(before: np.ndarray, after: np.ndarray) -> int:
    """How many pixels differ clearly."""
    return int((np.abs(before - after).sum(axis=2) > 60).sum())
