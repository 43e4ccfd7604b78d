"""What `backend.prepare` sets in a process of its own."""

import json
import os
import subprocess
import sys

OURS = (
    "DISPLAY",
    "DRONECOMBAT_CACHE",
    "MUJOCO_GL",
    "PYOPENGL_PLATFORM",  # set by MuJoCo, where an earlier test of this process has drawn
    "TF_CPP_MIN_LOG_LEVEL",
    "WAYLAND_DISPLAY",
    "XLA_FLAGS",
)


CLEAN = {
    name: value
    for name, value in os.environ.items()
    if name not in OURS and not name.startswith("JAX_")
}


PREPARE = """
import importlib.metadata, json, os, sys
importlib.metadata.version = lambda name: {version!r}
from dronecombat_jax.machine import backend
backend._cpu = lambda: ("a processor", {features!r})
{patch}
backend.prepare({device!r}, {cpu_devices})
assert "jax" not in sys.modules and "mujoco" not in sys.modules
print(json.dumps(dict(os.environ) | {{"set by us": backend._set_by_us}}))
"""


def prepared(
    tmp_path,
    version="0.12.0.1",
    device="cpu",
    patch="",
    cpu_devices=1,
    features="sse2 avx2",
    **environment,
) -> dict:
    """The environment after `prepare(device)` with jax `version`, in a fresh interpreter that never
    imports JAX.
    """
    code = PREPARE.format(
        version=version, device=device, patch=patch, cpu_devices=cpu_devices, features=features
    )
    given = CLEAN | {"DRONECOMBAT_CACHE": str(tmp_path)} | environment
    result = subprocess.run(
        [sys.executable, "-c", code], env=given, capture_output=True, text=True, check=True
    )
    return json.loads(result.stdout) | {"said": result.stderr}
