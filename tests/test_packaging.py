"""What is shipped: the wheel with its scene and presets, the pinned versions, the editable
checkout.
"""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from dronecombat_jax.config import settings
from dronecombat_jax.machine.backend import BAD_JAX
from dronecombat_jax.sim.scene import find_mjcf_dir

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PINS = [
    line
    for line in (ROOT / "constraints.txt").read_text().splitlines()
    if line and not line.startswith("#")
]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, unpacked. Built offline by the hatchling of this environment."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    assert built.stat().st_size < 6.5e6  # bytes, with 86 policies
    with zipfile.ZipFile(built) as archive:
        archive.extractall(folder / "unpacked")
    return folder / "unpacked"


def names(folder: Path, pattern: str) -> set[str]:
    return {
        str(path.relative_to(folder))
        for path in folder.glob(pattern)
        if "__pycache__" not in path.parts
    }


@pytest.mark.long
def test_the_wheel_holds_modules_scene_and_presets_and_nothing_else(wheel):
    package = wheel / "dronecombat_jax"
    assert names(package, "**/*.py") == names(ROOT / "dronecombat_jax", "**/*.py")
    assert names(package / "mjcf", "*.xml") == names(ROOT / "mjcf", "*.xml") != set()
    assert names(package / "experiments", "**/*") == names(ROOT / "experiments", "*.toml") != set()
    assert {path.name.split("-")[0] for path in wheel.iterdir()} == {"dronecombat_jax"}


def test_the_wheel_holds_the_pages_scripts_and_their_licence(wheel):
    files = names(wheel / "dronecombat_jax", "report/viewer/*")
    assert files == {f"report/viewer/{name}" for name in ("replay.js", "play.js", "three.LICENSE")}
    assert files == names(ROOT / "dronecombat_jax", "report/viewer/*")


def test_the_wheel_holds_the_pilots_and_their_cards(wheel):
    files = names(wheel / "dronecombat_jax", "pilots/*")
    others = {f"pilots/{name}.json" for name in ("cards", "ladder", "ladder_even")}
    assert others <= files and len(files) == 86 + len(others)
    assert files == names(ROOT / "dronecombat_jax", "pilots/*")


def test_the_wheel_installs_the_command(wheel):
    (entry_points,) = wheel.glob("*.dist-info/entry_points.txt")
    assert "dronecombat = dronecombat_jax.__main__:main" in entry_points.read_text()


def test_an_installed_package_finds_its_scene_and_presets(wheel, tmp_path):
    code = (
        "from dronecombat_jax.config import settings\n"
        "from dronecombat_jax.sim.scene import find_mjcf_dir, load_scene\n"
        "load_scene(settings.load('smoke').sim)\n"
        "print(find_mjcf_dir(), settings.find_preset('smoke'), sep='\\n')"
    )
    run = [sys.executable, "-c", code]
    result = subprocess.run(
        run, cwd=tmp_path, env={"PYTHONPATH": str(wheel)}, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr
    package = wheel / "dronecombat_jax"
    assert result.stdout.split() == [
        str(package / "mjcf"),
        str(package / "experiments" / "smoke.toml"),
    ]


def test_an_editable_checkout_finds_its_scene_and_presets():
    assert find_mjcf_dir() == ROOT / "mjcf"
    assert settings.find_preset("smoke") == ROOT / "experiments" / "smoke.toml"


def test_pins_are_names_and_versions_without_hosts():
    pin = re.compile(
        r"[a-z0-9-]+==[0-9][0-9.]*((b|\.post)[0-9]+)?( ; (python_full_version|sys_platform) (<|>=|==|!=) '[a-z0-9.]+')?"
    )
    assert [line for line in PINS if not pin.fullmatch(line)] == []


@pytest.mark.parametrize("python", ["3.11.7", "3.12.1", "3.13.0"])
def test_every_direct_dependency_is_pinned_to_a_version_that_it_allows(python):
    pins = {}
    for pin in map(Requirement, PINS):
        if pin.marker is None or pin.marker.evaluate(
            {"python_full_version": python, "sys_platform": "linux"}
        ):
            (specifier,) = pin.specifier
            pins[pin.name.lower()] = specifier.version
    extras = PROJECT["optional-dependencies"]
    named = (PROJECT["dependencies"], extras["test"], extras["dev"], extras["docs"])
    needed = [Requirement(text) for group in named for text in group]
    wrong = [
        str(requirement)
        for requirement in needed
        if requirement.name != PROJECT["name"]
        and not requirement.specifier.contains(pins.get(requirement.name.lower(), "0"))
    ]
    assert wrong == []


@pytest.mark.parametrize("version", sorted(BAD_JAX))
def test_known_bad_jax_is_excluded(version):
    (jax,) = (each for each in map(Requirement, PROJECT["dependencies"]) if each.name == "jax")
    assert not jax.specifier.contains(version)
