"""Seeds and environments on several devices: the same random numbers, the same mini-batches, the
same curves.

Everything is computed once, in a process with four virtual devices (`support/meshes.py`).
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import meshes
import numpy as np
import pytest

pytestmark = pytest.mark.slow
SPREAD = ("1x2", "1x4", "2x2")  # seeds x environments, all with several devices to a seed
TOGETHER = ("together-1x1", "together-1x2")  # both seeds side by side, as on a GPU
# Sums over environments in another order: 6 iterations of 2 x 4 gradient steps differed by 5e-5 at
# most, relative to 0.01 and above (Adam's first steps hardly depend on the gradient's size, so
# errors do not grow there).
RELATIVE, ABSOLUTE = 1e-3, 1e-4


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("meshes")
    flags = " ".join(
        word for word in os.environ.get("XLA_FLAGS", "").split() if "device_count" not in word
    )
    command = [sys.executable, meshes.__file__, str(path)]
    variables = os.environ | {"XLA_FLAGS": flags, "DRONECOMBAT_CACHE": str(path / "cache")}
    subprocess.run(command, env=variables, check=True, timeout=500)
    return path


def arrays(folder: Path, name: str) -> dict[str, np.ndarray]:
    with np.load(folder / f"{name}.npz", allow_pickle=False) as stored:
        return dict(stored)


def test_a_seed_on_a_device_of_its_own_has_the_bits_it_has_beside_another(folder):
    one, two = arrays(folder, "1x1"), arrays(folder, "2x1")
    assert [path for path in one if one[path].tobytes() != two[path].tobytes()] == []


@pytest.mark.parametrize("mesh", (*SPREAD, *TOGETHER))
def test_a_seed_on_several_devices_or_beside_another_learns_the_same_to_float_order(folder, mesh):
    """S-IPPO with a past opponent in each environment; metrics of every iteration and the final
    state.
    """
    one, several = arrays(folder, "1x1"), arrays(folder, mesh)
    assert one.keys() == several.keys() and one["curves/causes"].sum() > 20
    for path, expected in one.items():
        if expected.dtype.kind == "f":
            np.testing.assert_allclose(
                several[path], expected, rtol=RELATIVE, atol=ABSOLUTE, err_msg=path
            )
        else:
            np.testing.assert_array_equal(several[path], expected, err_msg=path)
    moved = one["learners/parameters/policy/weights/0"]
    assert np.any(moved != arrays(folder, "start")["learners/parameters/policy/weights/0"])


@pytest.mark.parametrize("mesh", SPREAD)
def test_noise_and_starts_belong_to_the_environment_and_not_to_the_device(folder, mesh):
    """Policies of zeros only draw noise: fights then have the same bits wherever they are flown."""
    one, several = arrays(folder, "flight-1x1"), arrays(folder, f"flight-{mesh}")
    assert (
        np.unique(one["qpos"].reshape(-1, 14), axis=0).shape[0]
        == one["qpos"].shape[0] * one["qpos"].shape[1]
    )
    assert [path for path in one if one[path].tobytes() != several[path].tobytes()] == []


@pytest.mark.parametrize("mesh", ["1x2", "1x4"])
def test_devices_do_not_wait_for_each_other_while_they_fly(folder, mesh):
    """Nothing is sent but the sums that a flight reports."""
    program = (folder / f"flight-{mesh}.txt").read_text()
    sent = re.findall(
        r"\b(all-reduce|all-gather|all-to-all|collective-permute|reduce-scatter)(?:-start)?\(",
        program,
    )
    assert sent and set(sent) == {"all-reduce"}
    shapes = " ".join(re.findall(r"= (.*?) all-reduce(?:-start)?\(", program))
    # 16 environments or the 8 with a defender, alone or times the steps
    assert not re.search(r"\[\d*(16|8)\b|\[96\b|,(16|8|96|48)[,\]]", shapes)
