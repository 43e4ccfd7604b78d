"""What cannot carry a policy's memory says so in one line."""

from pathlib import Path

import pytest
from policies import make_info, make_policy

from dronecombat_jax.adapters.opponents import pilots_of
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, LearnConfig, SelfPlayConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.policies.c_header import save_c
from dronecombat_jax.policies.file import save_policy
from dronecombat_jax.report.play_data import Opponent, opponent_data
from dronecombat_jax.runs.opponents import read_named
from dronecombat_jax.types import DEFENDER

POLICY = make_policy((35 + 12, 8, 4), state=12)
INFO = make_info(layer_sizes=(35, 8, 4), memory="gru 12")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    save_policy(tmp_path / "mine.safetensors", POLICY, INFO)
    return tmp_path / "mine.safetensors"


def refused(words: str, act, *given) -> None:
    with pytest.raises(UserError, match=words) as caught:
        act(*given)
    assert caught.value.exit_code == EXIT_CONFIG and "\n" not in caught.value.message


def test_a_header_for_c(tmp_path: Path):
    words = r"^policy.h: a policy with memory \(gru 12\) is exported as .safetensors alone$"
    refused(words, save_c, tmp_path / "policy.h", POLICY, INFO)


def test_the_page_on_which_a_person_flies():
    refused("^mine: the page flies", opponent_data, Opponent("mine", POLICY, LearnConfig()))


def test_a_view_of_one_side(file: Path):
    words = "a policy with memory cannot be met in a view of one side"
    refused(words, pilots_of, Combat(Config()), DEFENDER, str(file))


def test_training_whose_own_policies_remember_less(file: Path):
    """And where they remember as much, it is met."""

    def against(learn: LearnConfig) -> Config:
        return Config(learn=learn, selfplay=SelfPlayConfig(opponents=f"attacker={file} 0.5"))

    refused("it remembers 12 numbers of its fight, this run's", read_named, against(LearnConfig()))
    frozen = read_named(against(LearnConfig(memory="gru", memory_size=12)))
    assert [saved.info.memory for saved in frozen.saved.values()] == ["gru 12"]
