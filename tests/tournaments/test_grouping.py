"""Which runs are of one kind, and what else differs between them."""

from dataclasses import replace

import pytest

from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.tournaments.grouping import group, other_differences, read_configs


def written(tmp_path, name, preset="duel", **overrides):
    path = tmp_path / name
    path.mkdir(parents=True)
    config = settings.load(
        preset, {key.replace("__", "."): value for key, value in overrides.items()}
    )
    (path / "config.toml").write_text(
        settings.to_toml(replace(config, run=replace(config.run, name=path.name)))
    )
    return path


def test_runs_are_grouped_by_method_preset_or_any_setting(tmp_path):
    paths = [
        written(tmp_path, "a", train__seed=1),
        written(tmp_path, "b", selfplay__probability=0.2),
        written(tmp_path, "c", "paper"),
    ]
    configs = read_configs(paths)
    assert group(configs, "method") == {"a": "ippo", "b": "s-ippo", "c": "ippo"}
    assert group(configs, "preset") == {
        "a": "duel",
        "b": "duel, selfplay.probability 0.2",
        "c": "paper",
    }
    assert group(configs, "run") == {"a": "a", "b": "b", "c": "c"}
    told = group(configs, "selfplay.probability")
    assert (
        told["b"] == "selfplay.probability = 0.2"
        and told["a"] == told["c"] == "selfplay.probability = 0.0"
    )


def test_other_differences_are_told_but_not_the_seeds(tmp_path):
    paths = [
        written(tmp_path, "a", train__seed=1),
        written(tmp_path, "b", selfplay__probability=0.2, train__total_steps=10_000_000),
    ]
    configs = read_configs(paths)
    assert other_differences(configs, "method") == ["train.total_steps"]
    assert "selfplay.probability" in other_differences(configs, "train.total_steps")
    assert other_differences(configs, "preset") == ["train.total_steps"]


def test_mistakes_are_named(tmp_path):
    with pytest.raises(UserError, match="--by methode: did you mean method"):
        group({}, "methode")
    with pytest.raises(UserError, match=r"config\.toml: cannot be read") as raised:
        read_configs([tmp_path / "nowhere"])
    assert raised.value.exit_code == EXIT_DATA
    with pytest.raises(UserError, match="two runs are called a"):
        read_configs([written(tmp_path / "x", "a"), written(tmp_path / "y", "a")])
