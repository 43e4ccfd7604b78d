"""Which OpenGL MuJoCo uses here to draw without a window, and what is missing where it cannot.

What lives here: the one choice between EGL, OSMesa and GLFW, the Debian packages, an off-screen
context. What does not: what is drawn (`report`). Nothing at module level imports MuJoCo. It reads
MUJOCO_GL while it is imported, and where a library of the platform named there is missing, that
import itself fails: `settle` comes before it.
"""

import ctypes
import functools
import os
import platform
import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from dronecombat_jax.errors import UserError

# Of EGL. On a bare Debian 12 these three are enough, and none of them can be left out.
# README, .ci/run and all messages name them.
PACKAGES = ("libegl1", "libgl1-mesa-dri", "libopengl0")
# What PyOpenGL loads, by soname; of each row one is enough.
LIBRARIES = {
    "egl": (("libEGL.so.1",), ("libOpenGL.so.0", "libGL.so.1")),
    "osmesa": (("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),),
}
OFF = ("disable", "disabled", "off", "false", "0")
GLFW = ("glfw", "glx", "enable", "enabled", "on", "true", "1")  # all one for MuJoCo on Linux


class Choice(NamedTuple):
    """What MuJoCo shall draw with."""

    platform: str  # egl, osmesa or glfw; "" where nothing can be drawn
    fault: str  # why nothing can be drawn, and the remedy; "" where `platform` is named


def choose(variables: Mapping[str, str], loads: Callable[[str], bool]) -> Choice:
    """The platform that MUJOCO_GL names, and no other; where it names none, the first that this
    machine has.

    These are EGL, OSMesa and, where a display is named, GLFW. `variables`: the environment's;
    `loads`: whether a shared library can be loaded.
    """
    wanted = variables.get("MUJOCO_GL", "").lower().strip()
    shown = bool(variables.get("DISPLAY") or variables.get("WAYLAND_DISPLAY"))
    if wanted in OFF:
        return Choice("", f"MUJOCO_GL={wanted} forbids it. Fix: unset MUJOCO_GL")
    if wanted in GLFW:
        lack = "" if shown else "GLFW needs a display, and DISPLAY is empty. Fix: unset MUJOCO_GL"
        return Choice("" if lack else "glfw", lack)
    if wanted not in ("", *LIBRARIES):
        lack = f"MUJOCO_GL={wanted[:40]!r} must be egl, osmesa, glfw or off. Fix: unset MUJOCO_GL"
        return Choice("", lack)
    lacks = []
    for name in [wanted] if wanted else LIBRARIES:
        lacks.append(_lack(name, variables, loads))
        if not lacks[-1]:
            return Choice(name, "")
    return Choice("glfw", "") if shown and not wanted else Choice("", lacks[0])


@functools.cache
def choice() -> Choice:
    """The choice for this process, by the environment as it was at first: `settle` changes the
    environment.
    """
    return choose(os.environ, _loads)


def settle() -> str | None:
    """Set MUJOCO_GL so that MuJoCo can be imported; returns its value if that is new.

    Does nothing where that is no Linux, or where MuJoCo has been imported.
    """
    if platform.system() != "Linux" or "mujoco" in sys.modules:
        return None
    value = choice().platform or "off"
    if os.environ.get("MUJOCO_GL") == value:
        return None
    os.environ["MUJOCO_GL"] = value
    return value


def open_context(width: int, height: int) -> Any:
    """A current OpenGL context for pictures of at most `width` x `height` pixels.

    Its `free` frees it. Raises UserError with the reason and the remedy.
    """
    chosen = choice() if platform.system() == "Linux" else Choice("", "")
    if chosen.fault:
        raise UserError(chosen.fault)
    try:
        context = _context_class(chosen.platform)(width, height)
        context.make_current()
    except Exception as error:  # whatever a missing library or driver makes PyOpenGL trip over
        raise cannot_draw(error) from None
    return context


def cannot_draw(error: Exception) -> UserError:
    """The error to raise after OpenGL's `error`: one line with the remedy."""
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    name = choice().platform
    return UserError(f"OpenGL ({name}) does not start ({reason}). {_remedy(name)}".rstrip())


def fault() -> str | None:
    """None where MuJoCo can draw here, else one line with the remedy."""
    try:
        open_context(16, 16).free()
    except UserError as error:
        return error.message
    return None


def _lack(name: str, variables: Mapping[str, str], loads: Callable[[str], bool]) -> str:
    """What keeps MuJoCo from importing its platform `name`, and the remedy, or ""."""
    other = variables.get("PYOPENGL_PLATFORM", "")
    if other and other.lower() != name:
        return f"PYOPENGL_PLATFORM={other[:40]!r} forbids {name}. Fix: unset PYOPENGL_PLATFORM"
    for row in LIBRARIES[name]:
        if not any(map(loads, row)):
            return f"OpenGL ({name}): {row[0]} cannot be loaded. {_remedy(name)}"
    return ""


def _remedy(name: str) -> str:
    packages = ("libosmesa6",) if name == "osmesa" else PACKAGES
    install = f"apt-get install {' '.join(packages)} (on Debian or Ubuntu)"
    return {
        "egl": f"Fix: {install}",
        "osmesa": f"Fix: {install}, or unset MUJOCO_GL, for EGL",
        "glfw": f"Fix: unset MUJOCO_GL, for EGL: {install}",
    }.get(name, "")


def _context_class(name: str) -> Any:
    if name == "egl":
        from mujoco.egl import GLContext
    elif name == "osmesa":
        from mujoco.osmesa import GLContext
    elif name == "glfw":
        return _open_glfw
    else:
        from mujoco import GLContext
    return GLContext


def _open_glfw(width: int, height: int) -> Any:
    """A context of a hidden window.

    MuJoCo's own class goes on where GLFW has not started, and what is drawn then is a fatal error.
    """
    import glfw
    from mujoco.glfw import GLContext

    before, glfw.ERROR_REPORTING = glfw.ERROR_REPORTING, "raise"
    try:
        glfw.init()
        context = GLContext.__new__(GLContext)
        context._context = None  # its destructor reads this, also where no window can be opened
        context.__init__(width, height)
        return context
    finally:
        glfw.ERROR_REPORTING = before


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
