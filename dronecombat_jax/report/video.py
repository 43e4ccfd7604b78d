"""A picture and a short video of one fight.

Both come from a `Trajectory`; nothing is simulated here. What does not live here: the marks and
cameras (`stage`) and the text (`caption`).
"""

import io
import tempfile
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from dronecombat_jax.config.sides import DUEL, team
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.report.animation import encode_gif, encode_webp
from dronecombat_jax.report.caption import Caption, drawn_note
from dronecombat_jax.report.drawn_fight import (
    aim,
    finite_part,
    interpolate,
    is_down,
    numbers,
    points,
    poses,
    present,
    watched,
)
from dronecombat_jax.report.endings import caption as ending
from dronecombat_jax.report.endings import shown_names
from dronecombat_jax.report.stage import TARGET_COLOUR, TEAM_COLOURS, Stage
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import DEFENDER, SIDES, Cause, Trajectory

PICTURE_SIZE = (1600, 900)
VIDEO_SIZE = (960, 540)  # both even, as yuv420p wants
PICTURE_ASPECT = PICTURE_SIZE[0] / PICTURE_SIZE[1]  # that of a film, too
FRAME_RATE = 25
SHORTEST_VIDEO, LONGEST_VIDEO = 3.0, 8.0  # s; other fights are played slower or faster
HOLD = 2.0  # s, the outcome stays at the end
DOWN = 0.35  # how opaque a drone of a team that is down is drawn


def render_fight(
    trajectory: Trajectory,
    scene: Scene,
    path_png: Path | None,
    path_film: Path | None,
    *,
    intercept_radius: float = 0.5,
    reach_radius: float = 0.5,
) -> None:
    """Draw the whole fight into `path_png` and film it into `path_film` (a suffix of `FILMS`); None
    skips one.

    Radii in m, of the rules in force. Raises UserError where OpenGL is missing, the trajectory is
    empty or malformed, or a file cannot be written. Files appear only when they are complete.
    """
    fight = finite_part(trajectory)
    radii = (intercept_radius, reach_radius)
    width, height = np.maximum(PICTURE_SIZE, VIDEO_SIZE)
    for path in filter(None, (path_png, path_film)):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(path, error) from None
    with Stage(scene, int(width), int(height)) as stage:
        stage.set_state(fight.qpos[0], fight.target)
        stage.fit_arena_camera(points(fight, radii[1]), VIDEO_SIZE[0] / VIDEO_SIZE[1])
        if path_png is not None:
            content = io.BytesIO()
            Image.fromarray(_picture(stage, fight, radii)).save(content, "PNG")
            write_atomic(path_png, content.getvalue())
        if path_film is not None:
            write_atomic(path_film, FILMS[path_film.suffix](_frames(stage, fight, radii)))


def playback_speed(duration: float) -> float:
    """The power of 2 nearest to real speed at which `duration` s fill an agreeable video; at least
    1/8.
    """
    speed = 1.0
    while duration / speed < SHORTEST_VIDEO and speed > 0.125:
        speed /= 2.0
    while duration / speed > LONGEST_VIDEO:
        speed *= 2.0
    return speed


def encode(frames: Iterator[np.ndarray]) -> bytes:
    """Frames, uint8 [height, width, 3] of `VIDEO_SIZE`, as h264 in an MP4 that any player opens."""
    import av  # 60 ms that only a video needs

    with tempfile.TemporaryDirectory() as folder:
        # `faststart` reads its file again, which needs a name
        path = Path(folder) / "fight.mp4"
        with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            stream: Any = container.add_stream("libx264", rate=Fraction(FRAME_RATE))
            stream.width, stream.height = VIDEO_SIZE
            stream.pix_fmt = "yuv420p"
            stream.options = {"crf": "20", "preset": "veryfast"}
            for pixels in frames:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
            container.mux(stream.encode(None))
        return path.read_bytes()


# How frames, uint8 [height, width, 3], become a film, by the suffix of its file.
FILMS: dict[str, Callable[[Iterator[np.ndarray]], bytes]] = {
    ".mp4": encode,
    ".gif": partial(encode_gif, rate=FRAME_RATE),
    ".webp": partial(encode_webp, rate=FRAME_RATE),
}


def _picture(stage: Stage, fight: Trajectory, radii: tuple[float, float]) -> np.ndarray:
    """Trails, ghosts at regular times, both drones at the end and what happened."""
    width, height = PICTURE_SIZE
    stage.set_state(fight.qpos[-1], fight.target)
    stage.show_arena()
    every = max(1, round(_ghost_interval(fight) / fight.control_dt))
    for drone in present(fight):
        path, colour = poses(fight, drone), _colour(fight, drone)
        stage.add_trail(path[:, :3], colour)
        for index in range(0, len(path) - every // 2, every):
            if is_down(fight, index, drone):
                break  # it lies where it is drawn at the end
            stage.add_plumb_line(path[index, :3], colour, 0.35)
            stage.add_drone(drone, path[index], alpha=0.45)
        stage.add_plumb_line(path[-1, :3], colour, 0.9)
        stage.add_drone(drone, path[-1], alpha=DOWN if is_down(fight, -1, drone) else 1.0)
    _add_bubbles(stage, fight, len(fight.time) - 1, fight.qpos[-1], radii)
    caption = Caption(stage.pixels(width, height))
    _label_starts(stage, caption, fight)
    _number_drones(stage, caption, fight, fight.qpos[-1])
    text, _ = ending(Cause(fight.cause), fight.sides)
    caption.title(f"{text} after {fight.time[-1]:.2f} s", numbers(fight, len(fight.time) - 1))
    caption.legend(f"{drawn_note()}, ghosts every {every * fight.control_dt:.2g} s")
    return caption.pixels()


def _frames(stage: Stage, fight: Trajectory, radii: tuple[float, float]) -> Iterator[np.ndarray]:
    """The arena with a chase view of each drone; the last frame is held with the outcome."""
    duration = float(fight.time[-1] - fight.time[0])
    speed = playback_speed(duration)
    last = max(1, round(duration / speed * FRAME_RATE))
    for frame in range(last):
        yield _frame(
            stage, fight, radii, fight.time[0] + frame * speed / FRAME_RATE, speed, ended=False
        )
    outcome = _frame(stage, fight, radii, fight.time[-1], speed, ended=True)
    for _ in range(1 + round(HOLD * FRAME_RATE)):
        yield outcome


def _frame(
    stage: Stage,
    fight: Trajectory,
    radii: tuple[float, float],
    time: float,
    speed: float,
    ended: bool,
) -> Any:
    width, height = VIDEO_SIZE
    qpos = interpolate(fight, time)
    flown = int(np.searchsorted(fight.time, time, side="right"))
    index = min(flown, len(fight.time)) - 1
    stage.set_state(qpos, fight.target)
    stage.show_arena()
    for drone in present(fight):
        pose, colour = qpos[7 * drone : 7 * drone + 7], _colour(fight, drone)
        stage.add_trail(np.vstack([poses(fight, drone)[:flown, :3], pose[:3]]), colour)
        stage.add_plumb_line(pose[:3], colour, 0.8)
        stage.add_drone(drone, pose, alpha=DOWN if is_down(fight, index, drone) else 1.0)
    _add_bubbles(stage, fight, index, qpos, radii)
    caption = Caption(stage.pixels(width, height))
    _number_drones(stage, caption, fight, qpos)
    caption.title(f"t = {time:.2f} s", numbers(fight, index))
    for drone in watched(fight):
        inset, left, top = _inset(stage, fight, index, qpos, drone, radii)
        name = f"{shown_names(fight.sides)[drone]}'s chase camera"
        caption.inset(inset, left, top, name, _colour(fight, drone))
    caption.legend(drawn_note(speed))
    if ended:
        caption.banner(*ending(Cause(fight.cause), fight.sides))
    return caption.pixels()


def _inset(
    stage: Stage,
    fight: Trajectory,
    index: int,
    qpos: np.ndarray,
    drone: int,
    radii: tuple[float, float],
) -> Any:
    """A defender looks at an attacker, an attacker at the target; (pixels, left, top)."""
    width, height = VIDEO_SIZE[0] * 28 // 100, VIDEO_SIZE[1] * 28 // 100
    margin = VIDEO_SIZE[1] * 2 // 100
    stage.show_chase(drone, aim(fight, index, qpos, drone))
    _add_target(stage, fight, radii)
    left = margin if fight.sides[drone] == DEFENDER else VIDEO_SIZE[0] - width - margin
    return stage.pixels(width, height), left, VIDEO_SIZE[1] * 145 // 1000


def _add_target(stage: Stage, fight: Trajectory, radii: tuple[float, float]) -> None:
    stage.add_bubble(fight.target, radii[1], TARGET_COLOUR, 0.22)
    stage.add_bubble(fight.target, 0.06, TARGET_COLOUR, 1.0)


def _add_bubbles(
    stage: Stage, fight: Trajectory, index: int, qpos: np.ndarray, radii: tuple[float, float]
) -> None:
    """The radii of the rules: reach around the target, interception around each defender that flies."""
    _add_target(stage, fight, radii)
    for drone in present(fight):
        if fight.sides[drone] == DEFENDER and not is_down(fight, index, drone):
            centre = qpos[7 * drone : 7 * drone + 3]
            stage.add_bubble(centre, radii[0], TEAM_COLOURS[DEFENDER], 0.14)


def _label_starts(stage: Stage, caption: Caption, fight: Trajectory) -> None:
    """Names the target and where each side starts: in the middle of its drones."""
    foot = np.array([1.0, 1.0, 0.0])
    places = [(fight.target * foot, "target", TARGET_COLOUR, 0.045)]
    for side in sorted({fight.sides[drone] for drone in present(fight)}):
        mates = [drone for drone in present(fight) if fight.sides[drone] == side]
        start = np.mean([poses(fight, drone)[0, :3] for drone in mates], axis=0)
        whose = "s'" if len(mates) > 1 else "'s"
        text = f"{SIDES[side]}{whose} start"
        below = side == DEFENDER  # the fight is between the two: label both on the far side
        places.append(
            (start * foot if below else start, text, TEAM_COLOURS[side], 0.045 if below else -0.06)
        )
    for point, text, colour, offset in places:
        caption.label(stage.project(point, PICTURE_ASPECT)[0], text, colour, below=offset)


def _number_drones(stage: Stage, caption: Caption, fight: Trajectory, qpos: np.ndarray) -> None:
    """Each drone of a team has its number above it; in a duel the colours tell."""
    if fight.sides == DUEL:
        return
    for drone in present(fight):
        number = drone - team(fight.sides, fight.sides[drone]).start + 1
        place = stage.project(qpos[7 * drone : 7 * drone + 3], PICTURE_ASPECT)[0]
        caption.label(place, str(number), _colour(fight, drone), below=-0.05)


def _colour(fight: Trajectory, drone: int) -> tuple[float, ...]:
    return TEAM_COLOURS[fight.sides[drone]]


def _ghost_interval(fight: Trajectory) -> float:
    duration = fight.time[-1] - fight.time[0]
    return next((step for step in (0.1, 0.2, 0.3, 0.5, 1.0) if duration / step <= 10), 2.0)
