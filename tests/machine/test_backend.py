"""What is settled before JAX starts.

Each case runs in an interpreter of its own: settings are process-wide.
"""

import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from prepared import prepared

from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.machine import backend

CONSTRAINTS = Path(__file__).parents[2] / "constraints.txt"
DEADLOCK_OFF = "--xla_cpu_enable_concurrency_optimized_scheduler=false"


@pytest.mark.parametrize("device", ["cpu", "auto"])
def test_the_scheduler_that_deadlocked_is_off_with_jax_0_9(tmp_path, device):
    assert prepared(tmp_path, "0.9.2", device)["XLA_FLAGS"] == DEADLOCK_OFF


def test_jax_0_12_needs_no_flags(tmp_path):
    found = prepared(tmp_path, "0.12.0.1")
    assert "XLA_FLAGS" not in found
    assert "TF_CPP_MIN_LOG_LEVEL" not in found


def test_a_cpu_pretends_to_be_several_devices_unless_the_user_has_said_how_many(tmp_path):
    flag, patient = (
        "--xla_force_host_platform_device_count",
        f"{backend.MEETING_FLAG}={backend.MEETING_SECONDS}",
    )
    assert prepared(tmp_path, "0.12.0.1", cpu_devices=2)["XLA_FLAGS"] == f"{flag}=2 {patient}"
    old = prepared(tmp_path, "0.9.2", cpu_devices=2)
    assert old["XLA_FLAGS"] == old["set by us"]["XLA_FLAGS"] == f"{DEADLOCK_OFF} {flag}=2 {patient}"
    assert prepared(tmp_path, "0.13.0", cpu_devices=2)["XLA_FLAGS"] == f"{flag}=2"
    assert (
        prepared(tmp_path, "0.12.0.1", cpu_devices=2, XLA_FLAGS=f"{flag}=4")["XLA_FLAGS"]
        == f"{flag}=4 {patient}"
    )


@pytest.mark.parametrize("version", ["0.9.2", "0.12.0.1"])
def test_a_cpu_with_wide_vectors_uses_them(tmp_path, version):
    wide, narrow = (
        prepared(tmp_path, version, features=f"avx2 {extra}") for extra in ("avx512f", "avx")
    )
    assert "--xla_cpu_prefer_vector_width=512" in wide["XLA_FLAGS"].split()
    assert "vector_width" not in narrow.get("XLA_FLAGS", "")
    chosen = "--xla_cpu_prefer_vector_width=128"
    assert prepared(tmp_path, features="avx512f", XLA_FLAGS=chosen)["XLA_FLAGS"] == chosen


def test_a_version_of_jax_nobody_has_tried_gets_no_flags(tmp_path):
    assert "XLA_FLAGS" not in prepared(tmp_path, "0.13.0", features="avx512f")


def test_the_xla_of_this_environment_knows_every_flag_that_it_is_given(tmp_path):
    """XLA ends the process for a flag that it does not know."""
    features, version = "avx512f", metadata.version("jax")
    flags = prepared(tmp_path, version, cpu_devices=2, features=features)["XLA_FLAGS"]
    assert "vector_width" in flags
    code = "import jax; assert len(jax.devices()) == 2; jax.jit(lambda x: x @ x)(jax.numpy.ones((4, 4)))"
    environment = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    result = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr


def test_products_under_vmap_are_right_in_the_last_row_too():
    """jax 0.10.2 had 1071645696 there (jax#39103); right is the square of 32768."""
    import jax
    import jax.numpy as jnp

    rows = jnp.zeros((32_769, 3)).at[:, 0].set(jnp.arange(32_769.0))
    lengths = jax.jit(jax.vmap(lambda row: jnp.sum((jnp.eye(3) @ row) ** 2)))(rows)
    assert lengths[-1] == 2.0**30 and lengths[1234] == 1234.0**2


def test_flags_of_the_user_are_kept(tmp_path):
    found = prepared(tmp_path, "0.9.2", XLA_FLAGS="--xla_dump_to=here", TF_CPP_MIN_LOG_LEVEL="0")
    assert found["XLA_FLAGS"] == f"--xla_dump_to=here {DEADLOCK_OFF}"
    assert found["TF_CPP_MIN_LOG_LEVEL"] == "0"
    assert found["set by us"]["XLA_FLAGS"] == DEADLOCK_OFF


def test_a_scheduler_chosen_by_the_user_stays(tmp_path):
    chosen = DEADLOCK_OFF.replace("false", "true")
    assert prepared(tmp_path, "0.9.2", XLA_FLAGS=chosen)["XLA_FLAGS"] == chosen


def test_a_device_by_name_wins_over_the_environment_and_auto_does_not(tmp_path):
    assert prepared(tmp_path, device="cpu", JAX_PLATFORMS="cuda")["JAX_PLATFORMS"] == "cpu"
    started = {"patch": "backend.require_start = lambda: None"}
    assert (
        prepared(tmp_path, device="auto", JAX_PLATFORMS="cuda", **started)["JAX_PLATFORMS"]
        == "cuda"
    )
    assert "JAX_PLATFORMS" not in prepared(tmp_path, device="auto")


def test_programs_are_cached_per_version_of_jaxlib(tmp_path):
    old, new = (prepared(tmp_path, version) for version in ("0.9.2", "0.12.0.1"))
    folders = [found["JAX_COMPILATION_CACHE_DIR"] for found in (old, new)]
    assert folders[0] != folders[1]
    assert all(folder.startswith(str(tmp_path)) and os.path.isdir(folder) for folder in folders)
    assert float(new["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"]) == 0.0


def test_a_cache_that_cannot_be_written_is_left_out_and_said(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    found = prepared(tmp_path, DRONECOMBAT_CACHE=str(blocked))
    assert "JAX_COMPILATION_CACHE_DIR" not in found
    assert "cannot write" in found["set by us"]["JAX_COMPILATION_CACHE_DIR"]


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
@pytest.mark.parametrize(
    ("there", "environment", "expected"),
    [
        (True, {}, "egl"),
        (True, {"DISPLAY": ":0"}, "egl"),
        (False, {}, "off"),  # with "egl" and no libEGL, `import mujoco` itself would raise
        (False, {"MUJOCO_GL": "egl"}, "off"),
        (False, {"MUJOCO_GL": "osmesa"}, "off"),
        (True, {"MUJOCO_GL": "osmesa"}, "osmesa"),
    ],
)
def test_mujoco_is_given_what_it_can_import(tmp_path, there, environment, expected):
    found = prepared(
        tmp_path, patch=f"backend.rendering._loads = lambda library: {there}", **environment
    )
    assert found["MUJOCO_GL"] == expected
    assert found["set by us"].get("MUJOCO_GL") == (
        None if environment.get("MUJOCO_GL") == expected else expected
    )


@pytest.mark.parametrize("python", [(3, 11, 7), (3, 12, 1)])
@pytest.mark.parametrize("version", ["0.10.0", "0.10.1", "0.10.2", "0.11.0", "0.11.1"])
def test_known_bad_jax_is_refused_with_reason_and_the_pinned_versions_as_remedy(
    monkeypatch, version, python
):
    monkeypatch.setattr(metadata, "version", lambda name: version)
    monkeypatch.setattr(sys, "version_info", python)
    with pytest.raises(
        UserError, match=rf"jax {version} cannot be used: .*\. Fix: pip install '.*'$"
    ) as caught:
        backend.prepare("cpu")
    assert caught.value.exit_code == EXIT_CONFIG
    assert "\n" not in caught.value.message
    pins = [
        Requirement(line)
        for line in CONSTRAINTS.read_text().splitlines()
        if not line.startswith("#")
    ]
    here = {"python_full_version": ".".join(map(str, python))}
    pinned = {
        f"{pin.name}{pin.specifier}" for pin in pins if not pin.marker or pin.marker.evaluate(here)
    }
    remedy = set(re.findall(r"'(.*?)'", caught.value.message.partition("Fix: ")[2]))
    assert {name.partition("==")[0] for name in remedy} >= {"jax", "jaxlib"} and remedy <= pinned


@pytest.mark.parametrize("device", ["gpu", "tpu"])
def test_a_device_that_this_jax_cannot_drive_is_an_error(monkeypatch, device):
    monkeypatch.setattr(backend, "find_spec", lambda name: None)
    with pytest.raises(UserError, match=rf"device {device}: .*Fix: ") as caught:
        backend.prepare(device)
    assert caught.value.exit_code == EXIT_CONFIG


@pytest.mark.parametrize("device", ["gpu", "tpu"])
def test_a_device_that_is_not_in_the_machine_is_an_error(device):
    with pytest.raises(UserError, match=f"device {device}: there is none on this machine"):
        backend._require_devices(device)


def test_mjx_is_imported_without_a_word_on_stdout():
    code = "from dronecombat_jax.machine import backend; assert backend.import_mjx().step"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout == ""


def test_the_banner_names_machine_devices_versions_and_settings():
    machine, devices, versions, ours = backend.banner()
    assert "cores" in machine
    assert "cpu:0" in devices
    assert f"jax {metadata.version('jax')}" in versions
    assert ours.startswith("set by us ")
