"""What a view's `render` shows of a fight: a picture, or a line of text.

What does not live here: films and pictures of whole fights (`report.video`).
"""

from typing import Any

import numpy as np

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import drone_names
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import EnvState

RENDER_MODES = ("rgb_array", "ansi", "human")
WIDTH, HEIGHT = 960, 540


def require_mode(mode: str | None) -> str | None:
    """`mode`, which is one of `RENDER_MODES` or None. Raises UserError for others."""
    if mode is not None and mode not in RENDER_MODES:
        allowed = ", ".join(RENDER_MODES)
        raise UserError(f"render_mode = {one_line(str(mode))}: {allowed} or None are allowed")
    return mode


class Frames:
    """Draws the fights of one `Combat`; OpenGL is opened with the first picture."""

    def __init__(self, combat: Combat):
        self._combat = combat
        self._stage: Any = None

    def show(self, mode: str | None, fight: EnvState) -> np.ndarray | str | None:
        """The fight as `mode` says: uint8 [540, 960, 3], a line, or None once it is printed.

        Raises UserError where nothing can be drawn here.
        """
        if mode is None:
            return None
        if mode == "rgb_array":
            return self._picture(np.asarray(fight.qpos, float), np.asarray(fight.target, float))
        line = self._line(fight)
        if mode == "ansi":
            return line
        print(line)
        return None

    def close(self) -> None:
        """Give OpenGL's resources back."""
        if self._stage is not None:
            self._stage.__exit__()
            self._stage = None

    def _picture(self, qpos: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Both drones enlarged, with plumb lines, and the target, from the arena camera."""
        from dronecombat_jax.report.stage import TARGET_COLOUR, TEAM_COLOURS, Stage

        poses = qpos.reshape(-1, 7)
        if self._stage is None:
            self._stage = Stage(self._combat.scene, WIDTH, HEIGHT)
            self._stage.set_state(qpos, target)
            points = np.vstack([poses[:, :3], target])
            self._stage.fit_arena_camera(points, WIDTH / HEIGHT)
        self._stage.set_state(qpos, target)
        self._stage.show_arena()
        for drone, side in enumerate(self._combat.sides):
            if self._combat.game.flies[side]:
                self._stage.add_plumb_line(poses[drone, :3], TEAM_COLOURS[side], 0.8)
                self._stage.add_drone(drone, poses[drone])
        radius = self._combat.config.game.reach_radius
        self._stage.add_bubble(target, radius, TARGET_COLOUR, 0.25)
        return np.array(self._stage.pixels(WIDTH, HEIGHT))

    def _line(self, fight: EnvState) -> str:
        """Time and places, such as `0.42 s: defender at 0.0 4.8 1.1, ...` in m."""
        poses, sides = np.asarray(fight.qpos).reshape(-1, 7), self._combat.sides
        places = [
            f"{name} at {_spelt(pose[:3])}"
            for name, pose, side in zip(drone_names(sides), poses, sides, strict=True)
            if self._combat.game.flies[side]
        ]
        time = int(fight.clock) * self._combat.config.control_dt
        return f"{time:.2f} s: {', '.join(places)}, target at {_spelt(np.asarray(fight.target))}"


def _spelt(place: np.ndarray) -> str:
    return " ".join(f"{number:.1f}" for number in place)
