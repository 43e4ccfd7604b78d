"""The table of opponents: its spelling, its environments, and what does not go with it."""

from dataclasses import replace

import pytest

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, SelfPlayConfig, TrainConfig
from dronecombat_jax.config.opponents import (
    ATTACKER,
    DEFENDER,
    NOBODY,
    Row,
    described,
    learns,
    live_part,
    method,
    parse,
    places,
    stands_for,
    strike_margins,
    table,
)
from dronecombat_jax.errors import UserError


def config(opponents: str = "", envs: int = 64, solo: float = 0.0, **selfplay) -> Config:
    train = TrainConfig(num_envs=envs, solo_share=solo, head_start_steps=10**6)
    return Config(selfplay=SelfPlayConfig(opponents=opponents, **selfplay), train=train)


def test_every_kind_of_opponent_is_a_row():
    text = "attacker=past:latest 0.25, defender=scripted:hover .1,attacker=a file, 2.safetensors 0.2, defender=nobody 0.05"
    assert parse(text) == (
        Row(ATTACKER, "past:latest", 0.25),
        Row(DEFENDER, "scripted:hover", 0.1),
        Row(ATTACKER, "a file, 2.safetensors", 0.2),
        Row(DEFENDER, NOBODY, 0.05),
    )
    assert [(row.past, row.sampler, row.scripted, row.policy) for row in parse(text)] == [
        (True, "latest", "", ""),
        (False, "", "hover", ""),
        (False, "", "", "a file, 2.safetensors"),
        (False, "", "", ""),
    ]
    assert parse("defender=runs/ippo:12 0.2 of chunks") == (
        Row(DEFENDER, "runs/ippo:12", 0.2, True),
    )
    assert parse("defender=pilots:x") == (Row(DEFENDER, "pilots:x", None),)
    assert parse(" ") == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("attacker past 0.2", "'attacker past 0.2' is not SIDE=WHO SHARE"),
        ("pilot=past 0.2", "is not SIDE=WHO SHARE"),
        ("attacker=past 0.2 of days", "is not SIDE=WHO SHARE"),
        ("attacker=live 0.2", "is not SIDE=WHO SHARE"),
        ("attacker=past 1.5", "above 0, at most 1: 1.5"),
        ("attacker=past 0", "above 0, at most 1: 0"),
        ("attacker=past 0.2, attacker=past 0.3", "attacker=past is named twice"),
        ("attacker=nobody 0.2", "only defender=nobody SHARE"),
        ("defender=nobody 0.2 of chunks", "only defender=nobody SHARE"),
        ("attacker=past, defender=x", "one row alone may leave its share out"),
        ("attacker=past 0.2 of chunks, defender=x 0.1", "all of environments or all of chunks"),
        ("attacker=past 0.7, defender=x 0.7", "add up to 1.4"),
        ("attacker=past 0.7 of chunks, defender=x 0.7 of chunks", "add up to 1.4"),
        ("attacker=past:latest 0.1 of chunks, attacker=past 0.1 of chunks", "by one sampler alone"),
    ],
)  # fmt: skip
def test_a_misspelt_table_is_refused_in_one_line(text, message):
    with pytest.raises(UserError) as error:
        settings.load("smoke", {"selfplay.opponents": text})
    assert message in error.value.message and "\n" not in error.value.message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"selfplay.probability": 0.2}, "leave selfplay.probability out"),
        ({"selfplay.restore_live": False}, "restore_live"),
        ({"game.scenario": "solo"}, 'needs game.scenario = "duel"'),
        ({"train.solo_share": 0.9}, "more than all environments"),
        ({"learn.rollout_steps": 23, "train.num_envs": 60}, "leaves the attacker 48 environments and 1104"),
        ({"train.num_envs": 2}, "attacker=past: 0.2 of train.num_envs = 2 is no environment"),
    ],
)  # fmt: skip
def test_what_does_not_go_with_a_table_is_refused(changes, message):
    minibatches = 10 if "learn.rollout_steps" in changes else 6
    given = {"selfplay.opponents": "attacker=past 0.2", "learn.minibatches": minibatches} | changes
    with pytest.raises(UserError) as error:
        settings.load("smoke", given)
    assert message in error.value.message


def test_unknown_samplers_and_a_past_without_a_live_side_are_refused():
    for text, message in (
        ("attacker=past:best 0.2", "no sampler has this name"),
        ("attacker=past", "has no past"),
    ):
        with pytest.raises(UserError) as error:
            settings.load("smoke", {"selfplay.opponents": text})
        assert message in error.value.message


def test_older_settings_are_rows_of_the_table():
    assert table(config()) == ()
    assert table(config(probability=0.2)) == (Row(ATTACKER, "past", 0.2, True),)
    both = config(probability=0.2, roles="both", solo=0.125)
    assert table(both) == (
        Row(DEFENDER, NOBODY, 0.125),
        Row(DEFENDER, "past", 0.1, True),
        Row(ATTACKER, "past", 0.1, True),
    )
    assert both.solo_envs == 8 and live_part(both, DEFENDER) == slice(8, 64)
    assert live_part(both, ATTACKER) == slice(0, 64)
    assert described(both)[0] == "defender=nobody: 0.125 of the environments"
    assert described(both)[-1].startswith("defender=itself, untrained: the first ")


def test_environments_are_given_out_in_order_and_each_side_learns_where_it_is_live():
    text = "attacker=x 0.125, defender=scripted:hover 0.25, attacker=past 0.25"
    here = config(text, solo=0.125)
    given = [(place.row and place.row.who, place.first, place.stop) for place in places(here)]
    assert given == [
        ("nobody", 0, 8),
        ("scripted:hover", 8, 24),
        (None, 24, 40),
        ("x", 40, 48),
        ("past", 48, 64),
    ]
    assert live_part(here, DEFENDER) == slice(24, 64) and live_part(here, ATTACKER) == slice(0, 40)
    assert strike_margins(here) == ()
    odds = replace(here, train=replace(here.train, strike_margin=0.125))
    assert strike_margins(odds) == (0.0,) * 40 + (-0.125,) * 24


@pytest.mark.parametrize("envs", [7, 10, 63, 64, 1000])
def test_every_environment_has_one_place_however_shares_round(envs):
    for text in (
        "attacker=a 0.5, defender=b 0.5",
        "attacker=a 0.3, attacker=b 0.3, attacker=c 0.4",
    ):
        given = places(config(text, envs))
        ends = [place.stop for place in given]
        assert [place.first for place in given] == [0, *ends[:-1]] and ends[-1] == envs


def test_a_row_without_a_share_takes_what_is_left():
    attacker = config("defender=x", solo=0.25)  # trains the attacker, which may fly alone, too
    assert table(attacker) == (Row(DEFENDER, NOBODY, 0.25), Row(DEFENDER, "x", 0.75))
    assert not learns(attacker, DEFENDER) and learns(attacker, ATTACKER)
    assert stands_for(attacker, DEFENDER) == Row(DEFENDER, "x", 0.75)
    assert stands_for(attacker, ATTACKER) is None
    defender = config("attacker=x", solo=0.25)  # who would fly alone does not learn
    assert table(defender) == (Row(ATTACKER, "x", 1.0),)
    assert not learns(defender, ATTACKER) and defender.solo_envs == 0


def test_there_is_no_head_start_where_one_side_alone_learns():
    assert config().head_start_chunks == 27  # chunks of 25 x 24 x 64 = 38,400 steps
    for text in ("defender=x", "attacker=x"):
        assert config(text).head_start_chunks == 0
    assert config("attacker=x 0.5").head_start_chunks == 27


def test_a_method_has_a_name():
    names = {
        "": "ippo",
        "attacker=past 0.2": "s-ippo",
        "attacker=past 0.2, defender=x 0.1": "opponents",
    }
    assert {text: method(config(text)) for text in names} == names
    assert method(config(probability=0.2)) == "s-ippo" and method(config(solo=0.2)) == "ippo"
