"""Rules of the house that the import linter (`make check`) cannot express."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "dronecombat_jax"
MODULES = sorted(PACKAGE.rglob("*.py"))
CODE_THAT_RUNS_WHAT_IT_READS = {"pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve"}
NAMES_THAT_SAY_NOTHING = {"utils", "util", "common", "helpers", "base", "misc"}


def imports(path: Path) -> set[str]:
    """Top-level names of everything that a module imports, at any depth of its code."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_module_can_run_the_code_that_it_loads(path):
    assert imports(path) & CODE_THAT_RUNS_WHAT_IT_READS == set()


def test_names_say_what_lives_there():
    assert [
        path for path in MODULES if {path.stem, path.parent.name} & NAMES_THAT_SAY_NOTHING
    ] == []


def test_settings_backend_and_help_start_without_jax():
    code = (
        "import sys\n"
        "from dronecombat_jax.cli import commands, doctor\n"
        "from dronecombat_jax.config import settings\n"
        "from dronecombat_jax.machine import backend\n"
        "assert commands.main(['--help']) == 0\n"
        "heavy = {'jax', 'jaxlib', 'flax', 'optax', 'brax', 'mujoco', 'matplotlib', 'av'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
