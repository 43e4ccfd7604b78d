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

from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.report.animation import encode_gif, encode_webp
from dronecombat_jax.report.caption import Caption, drawn_note
from dronecombat_jax.report.stage import TARGET_COLOUR, TEAM_COLOURS, Stage
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Cause, Trajectory

PICTURE_SIZE = (1600, 900)
VIDEO_SIZE = (960, 540)  # both even, as yuv420p wants
FRAME_RATE = 25
SHORTEST_VIDEO, LONGEST_VIDEO = 3.0, 8.0  # s; other fights are played slower or faster
HOLD = 2.0  # s, the outcome stays at the end
_NEUTRAL = (0.85, 0.87, 0.90)

# What happened, in whose colour. Who wins by it is a matter of the rules of the run.
CAPTIONS: dict[Cause, tuple[str, tuple[float, ...]]] = {
    Cause.NONE: ("Fight cut short", _NEUTRAL),
    Cause.INTERCEPT: ("Defender intercepts the attacker", TEAM_COLOURS[DEFENDER]),
    Cause.REACHED: ("Attacker reaches the target", TEAM_COLOURS[ATTACKER]),
    Cause.DEFENDER_CRASH: ("Defender crashes", TEAM_COLOURS[ATTACKER]),
    Cause.ATTACKER_CRASH: ("Attacker crashes", TEAM_COLOURS[DEFENDER]),
    Cause.BOTH_CRASH: ("Both drones crash", _NEUTRAL),
    Cause.TIMEOUT: ("Time runs out", _NEUTRAL),
    Cause.DIVERGED: ("The simulation diverged", _NEUTRAL),
    Cause.DEFENDER_INVALID: ("Defender's action is not a number", TEAM_COLOURS[ATTACKER]),
    Cause.ATTACKER_INVALID: ("Attacker's action is not a number", TEAM_COLOURS[DEFENDER]),
    Cause.BOTH_INVALID: ("Both actions are not numbers", _NEUTRAL),
}


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
        stage.fit_arena_camera(_points(fight, radii), VIDEO_SIZE[0] / VIDEO_SIZE[1])
        if path_png is not None:
            content = io.BytesIO()
            Image.fromarray(_picture(stage, fight, radii)).save(content, "PNG")
            write_atomic(path_png, content.getvalue())
        if path_film is not None:
            write_atomic(path_film, FILMS[path_film.suffix](_frames(stage, fight, radii)))


def finite_part(trajectory: Trajectory) -> Trajectory:
    """The trajectory as float arrays, up to its first state that is not finite."""
    qpos, qvel = np.asarray(trajectory.qpos, float), np.asarray(trajectory.qvel, float)
    time, target = np.asarray(trajectory.time, float), np.asarray(trajectory.target, float)
    steps = len(time)
    if qpos.shape != (steps, 14) or qvel.shape != (steps, 12) or target.shape != (3,):
        raise UserError(
            f"trajectory: qpos {qpos.shape}, qvel {qvel.shape}, target {target.shape} "
            f"should be ({steps}, 14), ({steps}, 12), (3,)",
            EXIT_DATA,
        )
    finite = np.isfinite(qpos).all(axis=1) & np.isfinite(qvel).all(axis=1)
    end = steps if finite.all() else int(np.argmin(finite))
    if end == 0 or not np.isfinite(target).all():
        raise UserError("trajectory: no finite state to draw", EXIT_DATA)
    return trajectory._replace(time=time[:end], qpos=qpos[:end], qvel=qvel[:end], target=target)


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


def interpolate(fight: Trajectory, time: float) -> np.ndarray:
    """qpos [14] at `time` in s: positions linear, quaternions along the shorter arc, normalised."""
    after = int(np.clip(np.searchsorted(fight.time, time), 1, max(1, len(fight.time) - 1)))
    if len(fight.time) == 1:
        return fight.qpos[0]
    start, end = fight.time[after - 1], fight.time[after]
    share = float(np.clip((time - start) / (end - start), 0.0, 1.0))
    before, following = fight.qpos[after - 1].reshape(2, 7), fight.qpos[after].reshape(2, 7).copy()
    following[:, 3:] *= np.where(
        np.sum(before[:, 3:] * following[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0
    )
    mixed = (1.0 - share) * before + share * following
    mixed[:, 3:] /= np.maximum(np.linalg.norm(mixed[:, 3:], axis=1, keepdims=True), 1e-9)
    return mixed.reshape(14)


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
    for drone in _present(fight):
        poses, colour = _poses(fight, drone), TEAM_COLOURS[drone]
        stage.add_trail(poses[:, :3], colour)
        for index in range(0, len(poses) - every // 2, every):
            stage.add_plumb_line(poses[index, :3], colour, 0.35)
            stage.add_drone(drone, poses[index], alpha=0.45)
        stage.add_plumb_line(poses[-1, :3], colour, 0.9)
        stage.add_drone(drone, poses[-1])
    _add_bubbles(stage, fight, fight.qpos[-1], radii)
    caption = Caption(stage.pixels(width, height))
    _label_ends(stage, caption, fight)
    text, _ = CAPTIONS[Cause(fight.cause)]
    caption.title(f"{text} after {fight.time[-1]:.2f} s", _speeds(fight, len(fight.time) - 1))
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
    stage.set_state(qpos, fight.target)
    stage.show_arena()
    for drone in _present(fight):
        pose, colour = qpos[7 * drone : 7 * drone + 7], TEAM_COLOURS[drone]
        stage.add_trail(np.vstack([_poses(fight, drone)[:flown, :3], pose[:3]]), colour)
        stage.add_plumb_line(pose[:3], colour, 0.8)
        stage.add_drone(drone, pose)
    _add_bubbles(stage, fight, qpos, radii)
    caption = Caption(stage.pixels(width, height))
    caption.title(f"t = {time:.2f} s", _speeds(fight, min(flown, len(fight.time)) - 1))
    for drone in _present(fight):
        inset, left, top = _inset(stage, fight, qpos, drone, radii)
        caption.inset(inset, left, top, f"{SIDES[drone]}'s chase camera", TEAM_COLOURS[drone])
    caption.legend(drawn_note(speed))
    if ended:
        caption.banner(*CAPTIONS[Cause(fight.cause)])
    return caption.pixels()


def _inset(
    stage: Stage, fight: Trajectory, qpos: np.ndarray, drone: int, radii: tuple[float, float]
) -> Any:
    """The defender looks at the attacker, the attacker at the target; (pixels, left, top)."""
    width, height = VIDEO_SIZE[0] * 28 // 100, VIDEO_SIZE[1] * 28 // 100
    margin = VIDEO_SIZE[1] * 2 // 100
    stage.show_chase(drone, qpos[7:10] if drone == DEFENDER else fight.target)
    _add_bubbles(stage, fight, qpos, radii, cores=True)
    left = margin if drone == DEFENDER else VIDEO_SIZE[0] - width - margin
    return stage.pixels(width, height), left, VIDEO_SIZE[1] * 145 // 1000


def _add_bubbles(
    stage: Stage,
    fight: Trajectory,
    qpos: np.ndarray,
    radii: tuple[float, float],
    cores: bool = False,
) -> None:
    """The radii of the rules: interception around the defender, reach around the target."""
    stage.add_bubble(fight.target, radii[1], TARGET_COLOUR, 0.22)
    stage.add_bubble(fight.target, 0.06, TARGET_COLOUR, 1.0)
    if DEFENDER in _present(fight) and not cores:
        stage.add_bubble(qpos[:3], radii[0], TEAM_COLOURS[DEFENDER], 0.14)


def _label_ends(stage: Stage, caption: Caption, fight: Trajectory) -> None:
    aspect = PICTURE_SIZE[0] / PICTURE_SIZE[1]
    foot = np.array([1.0, 1.0, 0.0])
    places = [(fight.target * foot, "target", TARGET_COLOUR, 0.045)]
    for drone in _present(fight):
        start, text = _poses(fight, drone)[0, :3], f"{SIDES[drone]}'s start"
        below = drone == DEFENDER  # the fight is between the two: label both on the far side
        places.append(
            (start * foot if below else start, text, TEAM_COLOURS[drone], 0.045 if below else -0.06)
        )
    for point, text, colour, offset in places:
        caption.label(stage.project(point, aspect)[0], text, colour, below=offset)


def _speeds(fight: Trajectory, index: int) -> str:
    parts = [
        f"{SIDES[drone]} {np.linalg.norm(fight.qvel[index, 6 * drone : 6 * drone + 3]):.1f} m/s"
        for drone in _present(fight)
    ]
    if DEFENDER in _present(fight):
        parts.append(
            f"{np.linalg.norm(fight.qpos[index, :3] - fight.qpos[index, 7:10]):.2f} m apart"
        )
    parts.append(
        f"attacker {np.linalg.norm(fight.qpos[index, 7:10] - fight.target):.2f} m from the target"
    )
    return "   ".join(parts)


def _present(fight: Trajectory) -> tuple[int, ...]:
    """Both drones, or the attacker alone where the defender never moves (scenario solo)."""
    absent = len(fight.qpos) > 1 and not np.any(np.ptp(fight.qpos[:, :3], axis=0) > 1e-6)
    return (ATTACKER,) if absent else (DEFENDER, ATTACKER)


def _poses(fight: Trajectory, drone: int) -> np.ndarray:
    return fight.qpos[:, 7 * drone : 7 * drone + 7]


def _ghost_interval(fight: Trajectory) -> float:
    duration = fight.time[-1] - fight.time[0]
    return next((step for step in (0.1, 0.2, 0.3, 0.5, 1.0) if duration / step <= 10), 2.0)


def _points(fight: Trajectory, radii: tuple[float, float]) -> np.ndarray:
    """Everything the arena picture must hold: floor corners, both paths and the target's bubble."""
    corners = np.array([[x, y, 0.0] for x in (-5.0, 5.0) for y in (-5.0, 5.0)])
    paths = [_poses(fight, drone)[:, :3] for drone in _present(fight)]
    bubble = fight.target + radii[1] * np.vstack([np.eye(3), -np.eye(3)])
    return np.vstack([corners, *paths, bubble])
