"""Makes NAME.ipynb from each NAME.py beside it, and keeps their common cells alike: `make notebooks`.

The percent scripts are the source. Their cells tagged `badge` and `setup` are written from here,
so that what all notebooks share stands in one place. What does not live here: what they teach.
"""

import sys
from pathlib import Path

import jupytext
import nbformat

FOLDER = Path(__file__).resolve().parent
# A placeholder: the project's public address is not known yet. Put OWNER/NAME of its GitHub
# repository here, run `make notebooks`, and badges and install cells follow.
REPOSITORY = "OWNER/dronecombat-jax"

BADGE = (
    "[![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)]"
    "(https://colab.research.google.com/github/{repository}/blob/main/experiments/notebooks/{name}.ipynb)"
)
SETUP = '''\
# Installs the package with the versions that were tested together, unless it is here already.
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

REPOSITORY = "{repository}"  # a placeholder until the project has a public address


def install() -> None:
    """From the checkout around this notebook, or from REPOSITORY; versions of constraints.txt."""
    folders = [Path.cwd(), *Path.cwd().parents]
    checkouts = [path for path in folders if (path / "dronecombat_jax/__init__.py").is_file()]
    source = checkouts[0] if checkouts else Path("dronecombat-jax").absolute()
    if not source.is_dir():
        if REPOSITORY.startswith("OWNER/"):
            raise RuntimeError("REPOSITORY is a placeholder: open this notebook in a checkout")
        address = f"https://github.com/{{REPOSITORY}}"
        subprocess.run(["git", "clone", "--depth", "1", address, str(source)], check=True)
    package = f"{{source}}[cuda12]" if shutil.which("nvidia-smi") else str(source)
    command = [sys.executable, "-m", "pip", "install", "--quiet"]
    subprocess.run([*command, "-c", str(source / "constraints.txt"), package], check=True)
    importlib.invalidate_caches()
    if {{"jax", "numpy"}} & sys.modules.keys():  # of other versions than those installed now
        raise RuntimeError("installed: restart the session, then run all cells")


if importlib.util.find_spec("dronecombat_jax") is None:
    install()
import dronecombat_jax as dc

dc.prepare()  # before JAX is imported; refuses versions of it that hang or compute wrong numbers
import jax

from dronecombat_jax.machine.backend import banner

# "full" wants a GPU. "smoke" runs anywhere in about a minute: everything works, nothing is learnt.
SIZES = "smoke" if jax.default_backend() == "cpu" else "full"
if os.environ.get("DRONECOMBAT_NOTEBOOK") == "smoke":
    SIZES = "smoke"
print(*banner(), f"sizes     {{SIZES}}", sep="\\n")'''


def scripts() -> list[Path]:
    """The notebooks' sources, in order."""
    return sorted(FOLDER.glob("[0-9]*.py"))


def script_text(script: Path) -> str:
    """The percent script with its common cells as they must be. SystemExit where one is missing."""
    notebook = jupytext.reads(script.read_text(), fmt="py:percent")
    common = {
        "badge": BADGE.format(repository=REPOSITORY, name=script.stem),
        "setup": SETUP.format(repository=REPOSITORY),
    }
    for tag, source in common.items():
        cells = [cell for cell in notebook.cells if tag in cell.metadata.get("tags", ())]
        if len(cells) != 1:
            raise SystemExit(f"{script}: {len(cells)} cells are tagged {tag}; there must be one")
        cells[0].source = source
    notebook.metadata = nbformat.from_dict({"jupytext": {"notebook_metadata_filter": "-all"}})
    return jupytext.writes(notebook, fmt="py:percent")  # without a header that names versions


def notebook_text(script: str) -> str:
    """The .ipynb of a percent script: no outputs, no counts, and the same bytes every time."""
    notebook = jupytext.reads(script, fmt="py:percent")
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number}"
    name = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": name, "language_info": {"name": "python"}}
    )
    return nbformat.writes(notebook) + "\n"


def main() -> None:
    """Write every script and its notebook; name those that changed."""
    for script in scripts():
        source = script_text(script)
        for path, text in ((script, source), (script.with_suffix(".ipynb"), notebook_text(source))):
            if not path.is_file() or path.read_text() != text:
                path.write_text(text)
                print(f"written: {path}", file=sys.stderr)


if __name__ == "__main__":
    main()
