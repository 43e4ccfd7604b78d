"""By which OpenGL pictures are drawn: a table of variables and libraries, and real processes."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dronecombat_jax.machine import rendering
from dronecombat_jax.machine.rendering import PACKAGES, choose

ROOT = Path(__file__).parents[2]
EGL = ("libEGL.so.1", "libOpenGL.so.0")
OSMESA = ("libOSMesa.so.8",)
NOWHERE = {"DISPLAY": ":99"}  # an X server that has gone, as in a container or after ssh

linux = pytest.mark.skipif(sys.platform != "linux", reason="these libraries are Linux's")

# MUJOCO_GL, other variables, libraries that are there -> platform, or words of the line that says
# why not
TABLE = [
    ("", {}, EGL, "egl"),
    ("", NOWHERE, EGL, "egl"),
    ("", NOWHERE, (*EGL, *OSMESA), "egl"),
    ("", {}, ("libEGL.so.1", "libGL.so.1"), "egl"),
    ("", {}, OSMESA, "osmesa"),
    ("", NOWHERE, OSMESA, "osmesa"),
    ("", {"DISPLAY": ":0"}, (), "glfw"),
    ("", {"WAYLAND_DISPLAY": "wayland-0"}, (), "glfw"),
    ("", {"DISPLAY": ""}, (), "libEGL.so.1 cannot be loaded. Fix: apt-get install libegl1"),
    ("", {}, ("libEGL.so.1",), "libOpenGL.so.0 cannot be loaded. Fix: apt-get install libegl1"),
    ("", {}, ("libOpenGL.so.0",), "libEGL.so.1 cannot be loaded"),
    ("egl", {}, EGL, "egl"),
    (" EGL ", {}, EGL, "egl"),
    ("egl", {"DISPLAY": ":0"}, OSMESA, "libEGL.so.1 cannot be loaded"),
    ("egl", {}, ("libEGL.so.1",), "libOpenGL.so.0 cannot be loaded"),
    ("osmesa", {}, (*EGL, *OSMESA), "osmesa"),
    (
        "osmesa",
        {"DISPLAY": ":0"},
        EGL,
        "libOSMesa.so.8 cannot be loaded. Fix: apt-get install libosmesa6",
    ),
    ("glfw", {"DISPLAY": ":0"}, (), "glfw"),
    ("glx", NOWHERE, EGL, "glfw"),
    ("on", NOWHERE, EGL, "glfw"),
    ("glfw", {}, EGL, "GLFW needs a display"),
    ("glfw", {"DISPLAY": ""}, EGL, "GLFW needs a display"),
    ("off", {"DISPLAY": ":0"}, EGL, "MUJOCO_GL=off forbids it"),
    ("0", {}, EGL, "MUJOCO_GL=0 forbids it"),
    ("vulkan", {"DISPLAY": ":0"}, EGL, "MUJOCO_GL='vulkan' must be egl, osmesa, glfw or off"),
    ("", {"PYOPENGL_PLATFORM": "osmesa"}, EGL, "PYOPENGL_PLATFORM='osmesa' forbids egl"),
    ("", {"PYOPENGL_PLATFORM": "osmesa"}, (*EGL, *OSMESA), "osmesa"),
    ("egl", {"PYOPENGL_PLATFORM": "glx"}, EGL, "PYOPENGL_PLATFORM='glx' forbids egl"),
]


@pytest.mark.parametrize(("wanted", "variables", "libraries", "expected"), TABLE)
def test_the_choice_and_the_reason_for_none(wanted, variables, libraries, expected):
    chosen = choose(variables | {"MUJOCO_GL": wanted}, libraries.__contains__)
    if expected in ("egl", "osmesa", "glfw"):
        assert chosen == (expected, "")
    else:
        assert chosen.platform == "" and expected in chosen.fault and "\n" not in chosen.fault
        assert " Fix: " in chosen.fault


# The same in real processes: MuJoCo is imported, and doctor says what a picture meets.

CHILD = """
import ctypes, json, sys
hidden, load = {hidden!r}, ctypes.CDLL.__init__
def refuse(self, name, *args, **kwargs):
    if name and any(word in name for word in hidden):
        raise OSError(f"{{name}}: cannot open shared object file")
    load(self, name, *args, **kwargs)
ctypes.CDLL.__init__ = refuse

from dronecombat_jax.machine import backend, rendering
from dronecombat_jax.cli import doctor
backend.prepare("cpu")
import mujoco
verdict = doctor._report("rendering", doctor._rendering)
print(json.dumps([verdict, rendering.fault(), backend._set_by_us.get("MUJOCO_GL")]))
"""
CELLS = [
    (gl, display, hidden)
    for gl in ("", "egl", "osmesa", "glfw", "off", "vulkan")
    for display in ("", ":99")
    for hidden in (
        (),
        ("libEGL",),
        ("libOpenGL", "libGL."),
        ("libEGL", "libOpenGL", "libGL.", "OSMesa"),
    )
]
FEW = [
    ("", ":99", ()),
    ("osmesa", "", ("OSMesa",)),
    ("glfw", ":99", ()),
    ("egl", "", ("libOpenGL", "libGL.")),
]


def examined(
    gl: str, display: str, hidden: tuple[str, ...]
) -> tuple[bool, str | None, str | None, list[str]]:
    """Whether doctor's picture was drawn, the fault, what was set, and doctor's lines; nothing on
    stderr.
    """
    variables = os.environ | {"MUJOCO_GL": gl, "DISPLAY": display}
    for name in ("WAYLAND_DISPLAY", "PYOPENGL_PLATFORM"):
        variables.pop(name, None)
    command = [sys.executable, "-c", CHILD.format(hidden=hidden)]
    result = subprocess.run(command, env=variables, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, ""), result.stderr
    *lines, last = result.stdout.splitlines()
    return (*json.loads(last), lines)


def agree(gl: str, display: str, hidden: tuple[str, ...]) -> None:
    drawn, fault, value, lines = examined(gl, display, hidden)
    assert drawn == (fault is None)
    if drawn:
        assert value in (None, "egl", "osmesa") and len(lines) == 1
    else:
        assert (
            len(lines) == 2
            and lines[0].startswith("rendering    FAIL ")
            and lines[1].split()[0] == "fix:"
        )
    if gl in ("off", "vulkan") or hidden == CELLS[3][2] or (gl, display) == ("glfw", ":99"):
        assert not drawn


@linux
@pytest.mark.parametrize(("gl", "display", "hidden"), FEW)
def test_mujoco_is_imported_and_doctor_says_what_a_picture_meets(gl, display, hidden):
    agree(gl, display, hidden)


@linux
@pytest.mark.slow
@pytest.mark.parametrize(("gl", "display", "hidden"), CELLS)
def test_mujoco_is_imported_and_doctor_agrees_whatever_is_set_and_missing(gl, display, hidden):
    agree(gl, display, hidden)


@linux
@pytest.mark.slow
@pytest.mark.parametrize(
    ("variables", "films"),
    [
        ({"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "egl"}, False),
        ({"MUJOCO_GL": "glfw", "DISPLAY": ""}, False),
        ({"MUJOCO_GL": "glfw", "DISPLAY": ":99"}, False),
        ({"MUJOCO_GL": "vulkan"}, False),
        ({"DISPLAY": ":99"}, True),
        ({"MPLBACKEND": "module://matplotlib_inline.nowhere"}, True),
    ],
    ids=str,
)
def test_training_goes_on_and_one_line_says_why_no_fight_is_filmed(tmp_path, variables, films):
    if films and (fault := rendering.fault()):
        pytest.skip(fault)
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")
    }
    command = [sys.executable, "-m", "dronecombat_jax", "train", "--preset", "smoke", "--run.video"]
    result = subprocess.run(
        command, cwd=tmp_path, env=environment | variables, capture_output=True, text=True
    )
    assert (result.returncode, result.stderr) == (0, ""), result.stderr
    said = [
        line for line in result.stdout.splitlines() if line.startswith("no picture of a fight: ")
    ]
    assert len(said) == (not films) and all(" Fix: " in line for line in said)
    run = tmp_path / "runs" / "ippo-smoke"
    assert (run / "evaluation.json").is_file() and (run / "figures" / "learning.png").is_file()
    assert (run / "fight.mp4").is_file() == films


def test_one_list_of_packages():
    """README, continuous integration and every message name the same ones."""
    named = [*PACKAGES]
    for file in ("README.md", ".ci/run"):
        lists = re.findall(
            r"apt-get install (?:-\S+ )*(lib[a-z0-9-]+(?: lib[a-z0-9-]+)*)",
            (ROOT / file).read_text(),
        )
        assert [each.split() for each in lists] == [named], file
    faults = [
        choose({}, lambda name: False).fault,
        str(rendering.cannot_draw(RuntimeError("no device"))),
    ]
    assert all(f"apt-get install {' '.join(PACKAGES)} " in fault for fault in faults)
    others = [
        path for path in (ROOT / "dronecombat_jax").rglob("*.py") if "libegl1" in path.read_text()
    ]
    assert [path.name for path in others] == ["rendering.py"]
