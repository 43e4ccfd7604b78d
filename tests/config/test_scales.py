"""The paper's experiment at each scale: which runs it has and what they are estimated to take."""

from dataclasses import replace
from pathlib import Path

import pytest

from dronecombat_jax.config import costs, settings
from dronecombat_jax.config.scales import SCALES, run_configs
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError


@pytest.mark.parametrize("name", SCALES)
def test_both_runs_differ_in_self_play_alone_and_have_the_scales_chunks(name, tmp_path):
    scale = SCALES[name]
    ippo, sippo = run_configs(scale, tmp_path).values()
    assert {key for key, *_ in settings.diff(ippo, sippo)} == {"run.name", "selfplay.probability"}
    assert (ippo.selfplay.probability, sippo.selfplay.probability) == (0.0, 0.2)
    assert (ippo.num_chunks, ippo.train.num_seeds) == (scale.chunks, scale.seeds)
    assert ippo.run.keep == "all" and ippo.run.directory == str(tmp_path / "runs")


@pytest.mark.parametrize(
    ("name", "seeds", "chunks", "steps"),
    [("smoke", 2, 4, 3_072), ("laptop", 8, 100, 408_000), ("gpu", 16, 100, 1_008_000),
     ("paper", 8, 100, 10_008_000)],
)  # fmt: skip
def test_the_scales_are_those_of_the_docs(name, seeds, chunks, steps, tmp_path):
    config = run_configs(SCALES[name], tmp_path)["ippo"]
    assert (config.train.num_seeds, config.num_chunks) == (seeds, chunks)
    assert config.steps_per_chunk == steps


def test_another_game_may_be_asked_for(tmp_path):
    config = run_configs(SCALES["laptop"], tmp_path, preset="literal")["sippo"]
    assert not config.reward.time_scaled and config.num_chunks == 100
    with pytest.raises(UserError, match="did you mean"):
        run_configs(SCALES["laptop"], tmp_path, preset="literl")


def test_the_operations_of_a_step_are_those_of_the_performance_page():
    """5.0 MFLOP a step for the paper's networks, 0.34 of them forward in the rollout."""
    flops = costs.step_flops(settings.load("paper"))
    assert flops == pytest.approx(5.0e6, rel=0.02)
    forward = costs.step_flops(settings.load("paper", {"learn.epochs": 1}))
    # forward passes alone: one epoch has three passes, but for the observations' gradient
    layers = [(35, 256), (256, 128), (128, 4)], [(35, 256), (256, 128), (128, 1)]
    once = sum(2 * 2 * n * m for net in layers for n, m in net)
    assert once == pytest.approx(0.34e6, rel=0.02)
    assert forward == once + 3 * once - 2 * 2 * 2 * 35 * 256


def test_costs_grow_with_the_work_and_shrink_with_the_machine(tmp_path):
    scale = SCALES["laptop"]
    configs = run_configs(scale, tmp_path)
    slow, fast = (costs.cost_of(scale, configs, gflops, False) for gflops in (75.0, 150.0))
    assert slow.seconds > 1.9 * fast.seconds
    # two cores of 75 GFLOP/s, 653 M steps; 100,000 steps/s were measured at 83 GFLOP/s a core
    assert 1.6 * 3600 < fast.seconds < 2.4 * 3600
    assert fast.trainings["sippo"] < fast.trainings["ippo"]  # past attackers do not learn
    # measured: 1.6 GB with 5 fights of each pair of 1600 x 1600 players
    assert fast.memory == pytest.approx(1.6e9 + 1600**2 * 5 * 40, rel=0.2)
    assert fast.steps == 2 * 8 * 100 * 408_000
    large = costs.cost_of(SCALES["gpu"], run_configs(SCALES["gpu"], tmp_path), 150.0, True)
    assert large.seconds < fast.seconds / 8 and large.steps > 4 * fast.steps


def test_a_disk_that_is_too_small_is_refused_before_anything_starts(tmp_path, monkeypatch):
    scale = SCALES["smoke"]
    cost = costs.cost_of(scale, run_configs(scale, tmp_path), 100.0, False)
    costs.require_disk(cost, tmp_path)
    monkeypatch.setattr(costs, "free_bytes", lambda folder: cost.disk - 1)
    with pytest.raises(UserError, match=r"needs about .* of disk") as raised:
        costs.require_disk(cost, Path("reproductions/smoke"))
    assert raised.value.exit_code == EXIT_CANNOT_WRITE


def test_the_measured_rate_counts_all_cores():
    assert costs.measured_gflops(1) > 0


def test_who_does_not_learn_costs_nothing(tmp_path):
    """Of 100 chunks the defender misses 9, and a tenth of the environments in the others; the
    attacker misses a fifth of those after the head start but for the first.
    """
    configs = {
        name: replace(config, train=replace(config.train, head_start_steps=3_600_000))
        for name, config in run_configs(SCALES["laptop"], tmp_path).items()
    }
    assert configs["ippo"].head_start_chunks == 9
    assert costs.learning_shares(configs["ippo"]) == pytest.approx((0.91 * 0.9, 1.0))
    defender, attacker = costs.learning_shares(configs["sippo"])
    assert (defender, attacker) == pytest.approx((0.91 * 0.9, 1 - 0.2 * 0.91 * 0.99))
