"""The notebooks are those of their percent scripts, and run from top to bottom at smoke size."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import jupytext
import nbformat
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "experiments" / "notebooks"
SCRIPTS = sorted(NOTEBOOKS.glob("[0-9]*.py"))
LEARNER = "6_stable_baselines3"  # its own cell installs PyTorch
# A kernel runs each cell in turn, as "Run all" does; what the cells print goes into the file.
EXECUTE = """
import sys, nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(notebook, timeout=540, kernel_name="python3").execute()
nbformat.write(notebook, sys.argv[2])
"""


@pytest.fixture(scope="module")
def build() -> ModuleType:
    """`experiments/notebooks/build.py`."""
    spec = importlib.util.spec_from_file_location("build_notebooks", NOTEBOOKS / "build.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_six_are_here():
    assert [script.stem[0] for script in SCRIPTS] == ["1", "2", "3", "4", "5", "6"]
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == {path.stem for path in SCRIPTS}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_is_that_of_its_script(build, script):
    text = script.read_text()
    assert text == build.script_text(script), "run `make notebooks`: the common cells differ"
    written = script.with_suffix(".ipynb").read_text()
    assert written == build.notebook_text(text), "run `make notebooks`: the notebook differs"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_is_small_valid_and_without_outputs(script):
    path = script.with_suffix(".ipynb")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert path.stat().st_size < 30_000
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    assert "assert " in code[-1].source and "hold" in code[-1].source


def test_another_cell_or_address_is_noticed(build, tmp_path, monkeypatch):
    script = tmp_path / "1_try.py"
    script.write_text(SCRIPTS[0].read_text())
    # the badge carries the notebook's name: that alone makes it another script
    assert build.script_text(script) == script.read_text().replace(
        "1_first_fight.ipynb", "1_try.ipynb"
    )
    monkeypatch.setattr(build, "REPOSITORY", "someone/else")
    assert build.script_text(script).count("someone/else") == 2  # the badge and the install cell
    untagged = script.read_text().replace('tags=["setup"]', "")
    script.write_text(untagged)
    with pytest.raises(SystemExit, match="0 cells are tagged setup"):
        build.script_text(script)


def test_the_address_stands_in_one_place(build):
    sources = [path.read_text() for path in SCRIPTS]
    assert all(source.count(build.REPOSITORY) == 2 for source in sources)
    cells = [cell for text in sources for cell in jupytext.reads(text, fmt="py:percent").cells]
    tagged = {"badge", "setup"}
    others = [cell for cell in cells if not tagged & set(cell.metadata.get("tags", ()))]
    assert not any("github.com" in cell.source for cell in others)


@pytest.mark.tour
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_it_runs_from_top_to_bottom(script, tmp_path):
    if script.stem == LEARNER:
        pytest.importorskip("stable_baselines3")
    out = tmp_path / "executed.ipynb"
    command = [sys.executable, "-c", EXECUTE, str(script.with_suffix(".ipynb")), str(out)]
    environment = {**os.environ, "DRONECOMBAT_NOTEBOOK": "smoke", "MUJOCO_GL": "disabled"}
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr[-3000:]
    code = [cell for cell in nbformat.read(out, as_version=4).cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code)
    assert "all of this notebook's numbers hold" in str(code[-1].outputs)
    shown = [cell for cell in code if "dronecombat-replay-" in str(cell.outputs)]
    assert shown, "a replay is among the outputs"


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_install_cell_makes_the_environment(tmp_path):
    """All of them in a fresh clone, by an interpreter that has a notebook's kernel and nothing else."""
    checkout = tmp_path / "checkout"
    clone = ["git", "clone", "--quiet", str(NOTEBOOKS.parents[1]), str(checkout)]
    subprocess.run(clone, check=True)
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "venv")], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    kernel = ["nbclient", "nbformat", "ipykernel"]
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *kernel]
    made = subprocess.run(pip, capture_output=True, text=True)
    if made.returncode and "No matching distribution" in made.stderr:
        pytest.skip("no packages can be had here")
    assert made.returncode == 0, made.stderr
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
    environment = {**kept, "DRONECOMBAT_NOTEBOOK": "smoke", "MUJOCO_GL": "disabled"}
    for script in SCRIPTS:
        notebook = checkout / "experiments" / "notebooks" / f"{script.stem}.ipynb"
        command = [str(python), "-c", EXECUTE, str(notebook), str(tmp_path / "executed.ipynb")]
        ran = subprocess.run(
            command, cwd=notebook.parent, env=environment, capture_output=True, text=True
        )
        assert ran.returncode == 0, f"{script.stem}: {ran.stderr[-3000:]}"
