"""`dronecombat doctor`: one table of what this machine can do, with a remedy for what it cannot.

What does not live here: what is set up before JAX starts (`machine.backend`), and what only a run
can tell.
"""

import io
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.machine import backend

DISTRIBUTION = "dronecombat-jax"
REINSTALL = "pip install -c constraints.txt -e ."
SPHERE = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"


class Failed(Exception):
    """A check's verdict: what was found, and the remedy."""

    def __init__(self, finding: str, fix: str):
        super().__init__(finding)
        self.finding, self.fix = finding, fix


def doctor() -> int:
    """Print the table to stdout; 0 if all is well, else 2. A check that fails stops no other check."""
    checks: tuple[tuple[str, Callable[[], str]], ...] = (
        ("python", _python),
        ("packages", _packages),
        ("jax", _jax),
        ("devices", _devices),
        ("physics", _physics),
        ("rendering", _rendering),
        ("video", _video),
        ("runs folder", _runs),
        ("cache", _cache),
    )
    print(f"machine      {backend.machine()}", flush=True)
    verdicts = [_report(name, check) for name, check in checks]
    return 0 if all(verdicts) else EXIT_CONFIG


def doctor_mjcf(path: str) -> int:
    """Print how the drone or the scene at `path` is flown; 0 if as C MuJoCo flies it, else 2."""
    backend.prepare("cpu")
    from dronecombat_jax.config.fields import SimConfig
    from dronecombat_jax.sim.inspection import inspect

    try:
        inspection = inspect(SimConfig(mjcf=path))
    except UserError as error:
        print(f"{'file':12} FAIL  {error.message}")
        return EXIT_CONFIG
    for word, text in inspection.lines:
        print(f"{word:12} {text}")
    verdict = "ok    flown" if inspection.agrees else "FAIL  not flown"
    print(f"{'verdict':12} {verdict} as it is written")
    return 0 if inspection.agrees else EXIT_CONFIG


def _report(name: str, check: Callable[[], str]) -> bool:
    """Run one check, print its line, and a second one with the remedy where it failed."""
    try:
        print(f"{name:12} ok    {check()}", flush=True)
        return True
    except Failed as verdict:
        finding, fix = verdict.finding, verdict.fix
    except UserError as error:
        finding, _, fix = error.message.partition(" Fix: ")
    except Exception as error:  # a broken installation raises anything
        finding, fix = f"{type(error).__name__}: {' '.join(str(error).split())[:160]}", REINSTALL
    print(f"{name:12} FAIL  {finding}", flush=True)
    if fix:
        print(f"{'':12} fix:  {fix}", flush=True)
    return False


def _python() -> str:
    if not (3, 11) <= sys.version_info[:2] < (3, 14):
        raise Failed(platform.python_version(), "use Python 3.11, 3.12 (recommended) or 3.13")
    return platform.python_version()


def _packages() -> str:
    """Every requirement of this package is there, in a version that it allows."""
    wrong = []
    requirements = [Requirement(text) for text in metadata.requires(DISTRIBUTION) or ()]
    needed = [
        each for each in requirements if each.marker is None or each.marker.evaluate({"extra": ""})
    ]
    for requirement in needed:
        try:
            version = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{requirement} is missing")
            continue
        if not requirement.specifier.contains(version, prereleases=True):
            wrong.append(f"{requirement.name} {version} is not {requirement.specifier}")
    if wrong:
        raise Failed("; ".join(wrong), REINSTALL)
    return f"all {len(needed)} in the versions required"


def _jax() -> str:
    """Known-bad versions are refused; JAX is set up for the checks that follow."""
    backend.prepare()
    return f"jax {metadata.version('jax')}, jaxlib {metadata.version('jaxlib')}"


def _devices() -> str:
    backend.require_start()
    import jax

    return ", ".join(
        f"{device.platform}:{device.id} ({device.device_kind})" for device in jax.devices()
    )


def _physics() -> str:
    """A ball falls for one step under jit."""
    backend.require_start()
    import jax
    import mujoco

    mjx = backend.import_mjx()
    model = mjx.put_model(mujoco.MjModel.from_xml_string(SPHERE))
    speed = float(jax.jit(mjx.step)(model, mjx.make_data(model)).qvel[2])
    if not -0.1 < speed < -0.01:
        raise Failed(f"a falling ball has {speed} m/s after 2 ms, not -0.02", REINSTALL)
    return f"MJX {metadata.version('mujoco-mjx')} steps under jit"


def _rendering() -> str:
    """The scene can be drawn as a run draws its fights."""
    import numpy as np

    from dronecombat_jax.config.fields import SimConfig
    from dronecombat_jax.report.stage import Stage
    from dronecombat_jax.sim.scene import load_scene

    scene = load_scene(SimConfig())
    with Stage(scene, 64, 48) as stage:
        stage.set_state(scene.full.qpos0[:14], np.zeros(3))
        stage.show_arena()
        picture = stage.pixels(64, 48)
    if np.ptp(picture) == 0:
        raise Failed("a picture of the arena has one colour", "another OpenGL driver")
    return f"a {picture.shape[1]} x {picture.shape[0]} picture, MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}"


def _video() -> str:
    """Four grey pictures become an H.264 film in memory."""
    import av
    import numpy as np

    file = io.BytesIO()
    with av.open(file, mode="w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for shade in range(4):
            frame = av.VideoFrame.from_ndarray(
                np.full((48, 64, 3), 60 * shade, np.uint8), format="rgb24"
            )
            film.mux(stream.encode(frame))
        film.mux(stream.encode())
    return f"PyAV {metadata.version('av')} encodes H.264"


def _runs() -> str:
    """A file can be written where runs are kept."""
    folder = Path("runs") if Path("runs").is_dir() else Path()
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"dronecombat")
    except OSError as error:
        raise Failed(
            f"{folder.absolute()}: {error.strerror}", "train --run.directory FOLDER"
        ) from None
    return f"{folder.absolute()}: {shutil.disk_usage(folder).free / 2**30:.1f} GiB free"


def _cache() -> str:
    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if folder is None:
        raise Failed(
            f"{backend.cache_dir()}: cannot be written",
            "set DRONECOMBAT_CACHE to a folder of yours",
        )
    return folder
