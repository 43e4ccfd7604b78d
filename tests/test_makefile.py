"""What `make` says while it makes an environment; a stand-in for Python installs nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STAND_IN = """#!/bin/sh
case "$2" in
venv) mkdir -p "$4/bin" && cp "$0" "$4/bin/python" ;;
pip) for line in $(seq 200); do echo "Collecting package-$line"; done; echo "$@" >&2; exit {code} ;;
*) exec {python} "$@" ;;
esac
"""


@pytest.fixture
def make(tmp_path):
    """Runs `make` for one stamp of an environment in `tmp_path`; pip ends with `code`."""

    def run(stamp: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        python = tmp_path / "python"
        python.write_text(STAND_IN.format(code=code, python=sys.executable))
        python.chmod(0o755)
        venvs = [f"{name}={tmp_path / 'venv'}" for name in ("VENV", "PEERS_VENV")]
        command = ["make", f"PYTHON={python}", *venvs, str(tmp_path / "venv" / stamp)]
        # `make test` runs this test: what an outer make says to an inner one is left out
        outer = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS", "MAKEOVERRIDES")
        inner = {key: value for key, value in os.environ.items() if key not in outer}
        return subprocess.run(command, cwd=ROOT, env=inner, capture_output=True, text=True)

    return run


@pytest.mark.parametrize(
    ("stamp", "installs"), [(".runtime", 1), (".dev", 2), (".docs", 2), (".peers", 1)]
)
def test_an_environment_is_made_with_one_line_a_step(make, tmp_path, stamp, installs):
    result = make(stamp)
    assert result.returncode == 0 and result.stderr == ""
    first, *rest = result.stdout.splitlines()
    assert first.startswith("making ") and len(rest) == installs
    log = tmp_path / "venv" / "install.log"
    assert all(line.startswith("installing ") and str(log) in line for line in rest)
    said = log.read_text().splitlines()
    assert len(said) == installs * 201 and "install -c constraints.txt" in said[-1]
    assert (tmp_path / "venv" / stamp).is_file()


@pytest.mark.parametrize("stamp", [".runtime", ".dev", ".docs", ".peers"])
def test_where_pip_fails_its_last_words_and_the_log_are_named(make, tmp_path, stamp):
    result = make(stamp, code=1)
    *words, error, _ = result.stderr.splitlines()  # the last line is make's own
    assert (
        result.returncode == 2
        and str(tmp_path / "venv" / "install.log") in error
        and error.startswith("error: ")
    )
    assert len(words) == 5 and words[0] == "Collecting package-197"
    assert not (tmp_path / "venv" / stamp).exists()
