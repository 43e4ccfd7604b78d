"""Without its library, a view is refused in one line that names the extra."""

import importlib
import sys
import tomllib
from pathlib import Path

import pytest

from dronecombat_jax.errors import UserError

VIEWS = {
    "gymnasium_env": ("gymnasium", "gymnasium"),
    "pettingzoo_env": ("pettingzoo", "pettingzoo"),
    "sb3_env": ("stable_baselines3", "sb3"),
}


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_without_its_library_names_the_extra(view: str, monkeypatch: pytest.MonkeyPatch):
    library, extra = VIEWS[view]
    for name in [name for name in sys.modules if name.split(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)  # what import takes for "not there"
    module = f"dronecombat_jax.adapters.{view}"
    monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(UserError, match=rf"pip install 'dronecombat-jax\[{extra}\]'") as caught:
        importlib.import_module(module)
    assert "\n" not in caught.value.message


def test_the_extras_that_are_named_exist():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert {extra for _, extra in VIEWS.values()} <= project["optional-dependencies"].keys()
