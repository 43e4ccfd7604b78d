"""The picture and the video of a fight.

Rendering is skipped, with the reason, where EGL is missing.
"""

import io
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from duels import two_against_two
from PIL import Image

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_DATA, UserError
from dronecombat_jax.machine import rendering
from dronecombat_jax.report import video
from dronecombat_jax.report.animation import encode_gif, encode_webp
from dronecombat_jax.report.stage import Stage
from dronecombat_jax.report.video import finite_part, interpolate, playback_speed, render_fight
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.types import Cause, Trajectory


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SimConfig())


@pytest.fixture(scope="module")
def opengl() -> None:
    if fault := rendering.fault():
        pytest.skip(fault)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "PICTURE_SIZE", (480, 270))
    monkeypatch.setattr(video, "VIDEO_SIZE", (320, 180))
    monkeypatch.setattr(video, "SHORTEST_VIDEO", 0.1)
    monkeypatch.setattr(video, "HOLD", 0.2)


def fly(scene: Scene, steps: int = 10, cause: Cause = Cause.INTERCEPT) -> Trajectory:
    """Both drones in the full model under a constant wrench: a little more than hover, and a turn."""
    data = mujoco.MjData(scene.full)
    data.qpos[[2, 9]] = 0.8, 1.2
    data.ctrl[scene.controls[:, 0]] = 1.2 * scene.weight
    data.ctrl[scene.controls[:, 1]] = -1e-4, 1e-4
    states = []
    for _ in range(steps + 1):
        states.append((data.qpos.copy(), data.qvel.copy()))
        mujoco.mj_step(scene.full, data, 2)
    qpos, qvel = (np.array(rows) for rows in zip(*states, strict=True))
    time, action = 0.02 * np.arange(steps + 1), np.zeros((steps + 1, 2, 4))
    return Trajectory(time, qpos, qvel, action, np.array([5.0, 5.0, 1.0]), int(cause), 0.02)


@pytest.mark.usefixtures("opengl", "small")
def test_fight_gives_a_picture_and_a_film_that_play(scene: Scene, tmp_path: Path):
    import av

    fight = fly(scene)
    render_fight(fight, scene, tmp_path / "figures" / "fight.png", tmp_path / "fight.mp4")
    with Image.open(tmp_path / "figures" / "fight.png") as image:
        assert image.size == (480, 270)
        assert np.asarray(image).std() > 15
    with av.open(str(tmp_path / "fight.mp4")) as container:
        stream = container.streams.video[0]
        frames = sum(1 for _ in container.decode(stream))
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height, stream.average_rate) == (320, 180, 25)
    assert frames == 6 + 5  # 0.2 s at 25 per second, both ends; 0.2 s held
    assert {file.name for file in tmp_path.iterdir()} == {"figures", "fight.mp4"}


@pytest.mark.usefixtures("opengl", "small")
@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_the_same_film_as_a_moving_picture(suffix: str, scene: Scene, tmp_path: Path):
    render_fight(fly(scene), scene, None, tmp_path / f"fight{suffix}")
    with Image.open(tmp_path / f"fight{suffix}") as image:
        assert image.size == (320, 180) and image.info["loop"] == 0  # for ever
        assert np.asarray(image.convert("RGB")).std() > 15


@pytest.mark.parametrize("encode", [encode_gif, encode_webp])
def test_every_second_frame_of_a_moving_picture_is_shown_twice_as_long(encode):
    """Ten frames at 25 a second, each another grey: five are left, of 80 ms."""
    frames = [np.full((20, 32, 3), 20 * index, np.uint8) for index in range(10)]
    with Image.open(io.BytesIO(encode(iter(frames), rate=25))) as image:
        shown, lasts = [], []
        for index in range(getattr(image, "n_frames", 1)):
            image.seek(index)
            image.load()
            shown.append(int(np.asarray(image.convert("RGB")).mean()))
            lasts.append(image.info["duration"])
    assert shown == pytest.approx([0, 40, 80, 120, 160], abs=3) and lasts == [80] * 5


@pytest.mark.usefixtures("opengl", "small")
@pytest.mark.parametrize("case", ["one state", "diverged", "far away", "defender absent"])
def test_awkward_fights_are_drawn(case: str, scene: Scene, tmp_path: Path):
    fight = fly(scene, cause=Cause.TIMEOUT)
    if case == "one state":
        fight = fight._replace(
            time=fight.time[:1], qpos=fight.qpos[:1], qvel=fight.qvel[:1], action=fight.action[:1]
        )
    if case == "diverged":
        fight.qpos[5:, 3] = np.nan
        fight = fight._replace(cause=int(Cause.DIVERGED))
    if case == "far away":
        fight.qpos[:, 0] += np.linspace(0.0, 40.0, len(fight.qpos))
    if case == "defender absent":
        fight.qpos[:, :7] = fight.qpos[0, :7]
    render_fight(fight, scene, tmp_path / "fight.png", tmp_path / "fight.mp4")
    assert (tmp_path / "fight.png").stat().st_size > 5000
    assert (tmp_path / "fight.mp4").stat().st_size > 2000


@pytest.mark.usefixtures("opengl")
def test_both_drones_and_the_target_can_be_seen(scene: Scene):
    """Without each of them, the arena picture differs by hundreds of pixels of 960 x 540, in its
    colour.
    """
    fight = fly(scene)
    with Stage(scene, 960, 540) as stage:
        stage.set_state(fight.qpos[0], fight.target)

        def picture(*drones: int) -> np.ndarray:
            stage.show_arena()
            for drone in drones:
                stage.add_drone(drone, fight.qpos[0, 7 * drone : 7 * drone + 7])
            return stage.pixels(960, 540).astype(int)

        both = picture(0, 1)
        for drone, channel in ((0, 2), (1, 0)):  # the defender adds blue, the attacker red
            changed = np.abs(both - picture(1 - drone)).sum(axis=2) > 60
            assert changed.sum() > 300
            reds_and_blues = both[changed].mean(axis=0)
            assert np.argmax(reds_and_blues) == channel
        points = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (0, 3)], float)
        assert np.abs(stage.project(points, 960 / 540)).max() < 1.0


@pytest.mark.usefixtures("opengl", "small")
@pytest.mark.long
def test_teams_are_numbered_and_who_is_down_is_pale(tmp_path: Path, monkeypatch):
    """Drones 0 and 3 are down at the end; attacker 1 arrives, and defender 1 was nearest to it."""
    labels, insets, drawn = [], [], {}
    label, inset, add = video.Caption.label, video.Caption.inset, Stage.add_drone

    def labelled(self, at, text, *given, **named):
        labels.append(text)
        label(self, at, text, *given, **named)

    def framed(self, pixels, left, top, text, colour):
        insets.append(text)
        inset(self, pixels, left, top, text, colour)

    def added(self, drone, qpos, alpha=1.0, **named):
        drawn[drone] = alpha
        add(self, drone, qpos, alpha, **named)

    monkeypatch.setattr(video.Caption, "label", labelled)
    monkeypatch.setattr(video.Caption, "inset", framed)
    monkeypatch.setattr(Stage, "add_drone", added)
    fight = two_against_two(10)
    render_fight(fight, load_scene(SimConfig(), sides=fight.sides), tmp_path / "fight.png", None)
    assert labels == ["target", "defenders' start", "attackers' start", "1", "2", "1", "2"]
    assert drawn == {0: video.DOWN, 1: 1.0, 2: 1.0, 3: video.DOWN}
    drawn.clear()
    film = tmp_path / "fight.gif"
    render_fight(fight, load_scene(SimConfig(), sides=fight.sides), None, film)
    assert set(insets) == {"defender 1's chase camera", "attacker 1's chase camera"}
    assert drawn == {0: video.DOWN, 1: 1.0, 2: 1.0, 3: video.DOWN} and film.stat().st_size > 1000


def test_playback_speed():
    assert [playback_speed(duration) for duration in (0.1, 1.0, 2.0, 3.0, 8.0, 10.0, 100.0)] == [
        0.125, 0.25, 0.5, 1.0, 1.0, 2.0, 16.0]  # fmt: skip


def test_interpolation_is_halfway_and_takes_the_short_arc():
    """q and -q are one attitude: halfway between a quarter turn about z and its negative twin is
    that turn.
    """
    qpos = np.zeros((2, 14))
    turn = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    qpos[:, 3:7], qpos[:, 10:14] = [turn, -turn], [[1, 0, 0, 0], turn]
    qpos[1, 0] = 2.0
    fight = Trajectory(
        np.array([0.0, 0.02]), qpos, np.zeros((2, 12)), np.zeros((2, 2, 4)), np.zeros(3), 0, 0.02
    )
    middle = interpolate(fight, 0.01)
    assert middle[0] == pytest.approx(1.0)
    np.testing.assert_allclose(middle[3:7], turn)
    # 45 degrees
    np.testing.assert_allclose(middle[10:14], [np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)])
    np.testing.assert_array_equal(interpolate(fight, 9.0)[:3], qpos[1, :3])


def test_bad_trajectories_are_one_clear_line(scene: Scene):
    fight = fly(scene, steps=3)
    broken = fight._replace(qpos=np.full_like(fight.qpos, np.nan))
    for bad, words in (
        (broken, "no finite state"),
        (fight._replace(qpos=fight.qpos[:, :13]), "should be"),
    ):
        with pytest.raises(UserError, match=words) as raised:
            finite_part(bad)
        assert raised.value.exit_code == EXIT_DATA
        assert "\n" not in raised.value.message


def test_missing_opengl_names_the_packages(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    class Broken:
        def __init__(self, *_: int):
            # libEGL.so.1 absent
            raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(rendering, "choice", lambda: rendering.Choice("egl", ""))
    monkeypatch.setattr(rendering, "_context_class", lambda name: Broken)
    with pytest.raises(UserError) as raised:
        render_fight(fly(scene, steps=2), scene, tmp_path / "a.png", None)
    assert all(package in raised.value.message for package in rendering.PACKAGES)
    assert "\n" not in raised.value.message
    assert not list(tmp_path.iterdir())


def test_a_context_that_cannot_draw_is_one_line(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """MuJoCo says so when it makes its own context, as it did where GLFW had not started."""

    def refuse(*_: object) -> None:
        raise mujoco.FatalError("an OpenGL platform library has not been loaded")

    freed = []
    monkeypatch.setattr(
        rendering, "open_context", lambda *_: SimpleNamespace(free=lambda: freed.append(1))
    )
    monkeypatch.setattr(mujoco, "MjrContext", refuse)
    with pytest.raises(UserError, match="has not been loaded"):
        render_fight(fly(scene, steps=2), scene, tmp_path / "a.png", None)
    assert freed == [1] and not list(tmp_path.iterdir())


@pytest.mark.usefixtures("opengl", "small")
def test_unwritable_place_leaves_nothing_behind(scene: Scene, tmp_path: Path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot write") as raised:
        render_fight(fly(scene, steps=2), scene, tmp_path / "file" / "a.png", None)
    assert raised.value.exit_code == EXIT_CANNOT_WRITE
