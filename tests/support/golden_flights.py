"""Python's flights beside those of the play page's JavaScript: how either is asked."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dronecombat_jax.types import EnvState

CODE = Path(__file__).with_name("golden_flights.js")
SIM = Path(__file__).parents[2] / "viewer" / "src" / "sim" / "index.js"
FIELDS = ("position", "quaternion", "velocity", "rate")
_PROGRAM = """
import {{ readFileSync }} from "node:fs";
import * as sim from {sim};
{code}
process.stdout.write(JSON.stringify(answer(sim, JSON.parse(readFileSync(0, "utf8")))));
"""


def in_node(asked: dict[str, Any]) -> dict[str, Any]:
    """The answer of the sources in node; skips, with the reason, where there is none."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node here to run the page's code with")
    program = _PROGRAM.format(sim=json.dumps(SIM.as_uri()), code=CODE.read_text())
    run = subprocess.run(
        [node, "--input-type=module", "-e", program],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def as_json(state: EnvState) -> dict[str, Any]:
    """One fight's state as the page's code holds it."""
    drones = []
    for pose, twist in zip(
        np.reshape(state.qpos, (2, 7)), np.reshape(state.qvel, (2, 6)), strict=True
    ):
        parts = (pose[:3], pose[3:], twist[:3], twist[3:])
        drones.append(dict(zip(FIELDS, (part.tolist() for part in parts), strict=True)))
    return {
        "drones": drones,
        "target": np.asarray(state.target).tolist(),
        "clock": int(state.clock),
        "out": np.asarray(state.down).tolist(),
        "cause": 0,
    }


def numbers(state: dict[str, Any]) -> np.ndarray:
    """[26]: qpos 14, qvel 12 of a state of the page's code."""
    drones = state["drones"]
    qpos = [[*drone["position"], *drone["quaternion"]] for drone in drones]
    qvel = [[*drone["velocity"], *drone["rate"]] for drone in drones]
    return np.concatenate([np.ravel(qpos), np.ravel(qvel)])
