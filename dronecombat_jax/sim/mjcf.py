"""MJCF files as MuJoCo reads them: which files one is made of, one clear line for what is wrong.

What does not live here: what a file must hold (`scene`), and what of it can be flown (`written`).
"""

import warnings
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from dronecombat_jax.errors import UserError


def files_of(path: Path) -> list[Path]:
    """The MJCF at `path` and every file that it includes, attaches or shows.

    Raises UserError for a file that is absent or no XML, and for a name that leaves the folder.
    """
    root = path.resolve().parent
    trees: dict[Path, ElementTree.Element] = {}
    pending = [(path.resolve(), "")]
    while pending:
        file, parent = pending.pop()
        if file in trees:
            continue
        tree = trees[file] = _read(file, parent, root)
        _refuse_outside(file, tree, root)
        for element in tree.iter():
            if element.tag in ("include", "model") and (name := element.get("file")):
                pending.append(((root / name).resolve(), f", which {file} names"))
    folders = [folder for tree in trees.values() for folder in _asset_folders(tree)]
    names = {element.get("file", "") for tree in trees.values() for element in tree.iter()}
    places = {(root / folder / name).resolve() for folder in folders for name in names}
    return sorted(trees.keys() | {place for place in places if place.is_file()})


def parse(path: Path) -> mujoco.MjSpec:
    """The file at `path` as a specification that can still be changed. Raises UserError."""
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, OSError) as error:
        raise UserError(f"{path}: {_one_line(error)}") from None


def compiled(path: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a specification that was read from `path`. Raises UserError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # MuJoCo itself prints them, too
            return spec.compile()
    except (ValueError, OSError) as error:
        raise UserError(f"{path}: {_one_line(error)}") from None


def _read(file: Path, parent: str, root: Path) -> ElementTree.Element:
    if not file.is_file():
        others = ", ".join(sorted(other.name for other in root.glob("*.xml"))) or "none"
        raise UserError(f"{file}: no such file{parent} (MJCF files in {root}: {others})")
    try:
        return ElementTree.fromstring(file.read_bytes())
    except ElementTree.ParseError as error:
        raise UserError(f"{file}: not well-formed XML: {_one_line(error)}") from None
    except OSError as error:
        raise UserError(f"{file}: cannot be read: {error.strerror}") from None


def _refuse_outside(file: Path, tree: ElementTree.Element, root: Path) -> None:
    for element in tree.iter():
        if (name := element.get("file")) is None:
            continue
        for folder in _asset_folders(tree):
            if not (root / folder / name).resolve().is_relative_to(root):
                where = f'<{element.tag} file="{name}">'
                raise UserError(f"{file}: {where} leaves the folder {root}")


def _asset_folders(tree: ElementTree.Element) -> list[Path]:
    """Where meshes and textures may lie, relative to the MJCF; the first is its own folder."""
    keys = ("assetdir", "meshdir", "texturedir")
    compilers = tree.iter("compiler")
    return [Path(), *(Path(compiler.get(key, "")) for compiler in compilers for key in keys)]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
