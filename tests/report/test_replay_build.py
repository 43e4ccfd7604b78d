"""The built scripts are those of the sources in `viewer/`, with their licence."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from dronecombat_jax.report import play_page, replay_page

VIEWER = Path(__file__).parents[2] / "viewer"
SCRIPTS = (replay_page.SCRIPT, play_page.SCRIPT)
PACKAGE = json.loads((VIEWER / "package.json").read_text())


def digest() -> str:
    """As `viewer/build.mjs` computes it, over what the scripts are made from."""
    names = [
        "build.mjs",
        "package.json",
        *(str(path.relative_to(VIEWER)) for path in (VIEWER / "src").rglob("*") if path.is_file()),
    ]
    total = hashlib.sha256()
    for name in sorted(names):
        content = (VIEWER / name).read_bytes()
        total.update(f"{name} {len(content)}\n".encode() + content)
    return total.hexdigest()


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_a_built_script_names_these_sources(path: Path):
    assert f"\nsources sha256 {digest()}\n" in path.read_text()[:1000], (
        "the pages' sources have changed: npm install && npm run build in viewer/"
    )
    assert replay_page.sources() == digest()


def test_versions_are_exact_and_no_host_is_named():
    versions = PACKAGE["devDependencies"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions.values())
    lock = (VIEWER / "package-lock.json").read_text()
    assert "resolved" not in lock and "http" not in lock
    locked = json.loads(lock)["packages"]
    assert all(
        locked[f"node_modules/{name}"]["version"] == version for name, version in versions.items()
    )


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_the_licence_of_what_is_inside_is_beside_it_and_in_it(path: Path):
    licence, script = path.with_name("three.LICENSE").read_text().strip(), path.read_text()
    assert "The MIT License" in licence and "three.js authors" in licence
    assert licence in script and f"three.js {PACKAGE['devDependencies']['three']}" in script


def test_a_new_build_is_the_same_to_the_byte(tmp_path):
    installed = VIEWER / "node_modules" / "three" / "package.json"
    if not shutil.which("node"):
        pytest.skip("no node here to build the replay page with")
    if not installed.is_file():
        pytest.skip("npm install in viewer/ brings what the replay page is built with")
    assert json.loads(installed.read_text())["version"] == PACKAGE["devDependencies"]["three"]
    subprocess.run(
        ["node", "build.mjs", str(tmp_path)], cwd=VIEWER, check=True, capture_output=True
    )
    for path in SCRIPTS:
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()
