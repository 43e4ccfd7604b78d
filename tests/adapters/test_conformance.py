"""The checker finds each planted fault, and none where none is."""

import pytest
from brax_views import LENGTH, hold, make
from faulty import GYMNASIUM, LIMIT, NEXT_STEP, PETTINGZOO, ToyParallel, ToyVector
from faulty_jax import BRAX, JAXMARL, ToyBrax, ToyMarl
from gymnasium.vector import AutoresetMode
from toy import Coasting

from dronecombat_jax.adapters import NonConforming, check, examine
from dronecombat_jax.adapters.brax_env import wrap
from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ATTACKER, DEFENDER


def rules(report) -> set[str]:
    return {fault.rule for fault in report.faults}


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
def test_a_gymnasium_environment_without_a_fault_has_none(mode: AutoresetMode):
    report = check(ToyVector(mode=mode), steps=100)
    assert report.unseen == ()
    assert str(report) == "no fault was found"


@pytest.mark.parametrize("fault", GYMNASIUM)
def test_a_fault_of_a_gymnasium_environment_is_found(fault: str):
    assert GYMNASIUM[fault] in rules(examine(ToyVector(fault), steps=100))


@pytest.mark.parametrize("fault", NEXT_STEP)
def test_a_fault_of_one_that_begins_anew_a_step_later_is_found(fault: str):
    report = examine(ToyVector(fault, AutoresetMode.NEXT_STEP), steps=100)
    assert NEXT_STEP[fault] in rules(report)


def test_a_fault_raises_and_is_named():
    with pytest.raises(NonConforming, match=r"truncation: all .* fights that lasted 12") as it:
        check(ToyVector("truncation told as termination"), steps=100)
    assert rules(it.value.report) == {"truncation"}


def test_what_was_not_tested_is_told():
    report = examine(ToyVector(), steps=3)
    assert any("no fight ended" in line for line in report.unseen)
    env = ToyVector()
    env.time_limit = None  # pyright: ignore[reportAttributeAccessIssue]
    assert any("pass time_limit=" in line for line in examine(env, steps=100).unseen)
    assert rules(examine(env, steps=100, time_limit=LIMIT - 1)) == {"time-limit"}


def test_another_kind_of_environment_is_one_line():
    with pytest.raises(UserError, match="int is none of Gymnasium's") as caught:
        check(3)
    assert "\n" not in caught.value.message


def test_a_pettingzoo_environment_without_a_fault_has_none():
    report = check(ToyParallel(), steps=150)
    assert report.unseen == ("fights-alike, neighbours, lost-transition: there is one fight alone",)


@pytest.mark.parametrize("fault", PETTINGZOO)
def test_a_fault_of_a_pettingzoo_environment_is_found(fault: str):
    assert PETTINGZOO[fault] in rules(examine(ToyParallel(fault), steps=150))


@pytest.mark.parametrize("toy", [ToyBrax, ToyMarl])
def test_an_environment_of_jax_without_a_fault_has_none(toy: type):
    report = check(toy(), steps=100)
    assert report.unseen == ()


@pytest.mark.parametrize("fault", BRAX)
def test_a_fault_of_a_brax_environment_is_found(fault: str):
    assert BRAX[fault] in rules(examine(ToyBrax(fault), steps=100))


@pytest.mark.parametrize("fault", JAXMARL)
def test_a_fault_of_a_jaxmarl_environment_is_found(fault: str):
    assert JAXMARL[fault] in rules(examine(ToyMarl(fault), steps=100))


@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
@pytest.mark.long
def test_our_gymnasium_view_has_no_fault(mode: AutoresetMode, role: int):
    combat = Coasting(Config(game=GameConfig(episode_steps=LENGTH)))
    assert check(CombatVectorEnv(combat, role, hold, 6, mode), steps=150).unseen == ()


@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
@pytest.mark.long
def test_our_brax_view_has_no_fault(role: int):
    assert check(wrap(make(role), LENGTH), steps=150).unseen == ()
