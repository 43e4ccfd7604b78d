"""`dronecombat reproduce`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dronecombat_jax.cli.start import rate_on_one_core
from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting
from dronecombat_jax.files.rundir import run_path

if TYPE_CHECKING:
    from dronecombat_jax.cli.reproduction import Step
    from dronecombat_jax.config.costs import Cost
    from dronecombat_jax.config.fields import Config
    from dronecombat_jax.config.scales import Scale

ROOT = "reproductions"
LARGE_GPU_SCALES = ("gpu",)  # estimated for one, unless --device says cpu


@dataclass(frozen=True)
class ReproduceFlags:
    """The paper's experiment: IPPO and S-IPPO from the same seeds, their tournament, the report.

    Says first what it will take. Stopped or killed, the same command goes on; what is finished is
    not done again. All of it lies in reproductions/NAME (docs/reproduce.md). Such as

        dronecombat reproduce --scale smoke
        dronecombat reproduce --scale laptop
        dronecombat reproduce --scale paper --estimate
    """

    scale: Literal["smoke", "laptop", "gpu", "paper"] = setting(
        "laptop",
        "smoke: 2 seeds, 4 tiny chunks; laptop: 8 seeds, 100 chunks of 0.4 M steps; gpu: 16 seeds, "
        "100 chunks of 1 M; paper: 8 seeds, 100 chunks of 10 M",
    )
    preset: str = setting("", "game and learner, a preset or a .toml file (default: the scale's)")
    name: str = setting("", "folder in reproductions/ (default: the scale, and --preset if given)")
    estimate: bool = setting(False, "say what it will take, and stop")
    device: Literal["auto", "cpu", "gpu", "tpu"] = setting("auto", "where to compute")


def reproduce(args: Sequence[str]) -> int:
    """the paper's experiment: both methods, their tournament, the report"""
    given: ReproduceFlags = flags.read(ReproduceFlags, args, "dronecombat reproduce")
    rate_on_one_core()
    from dronecombat_jax.cli.reproduction import claimed, finished, steps_of
    from dronecombat_jax.config import costs
    from dronecombat_jax.config.scales import SCALES, run_configs
    from dronecombat_jax.machine.backend import cores

    scale = SCALES[given.scale]
    named = Path(given.preset).stem if given.preset else ""
    folder = run_path(ROOT, given.name or "-".join(filter(None, (given.scale, named))))
    configs = run_configs(scale, folder, given.preset, given.device)
    gpu = given.device == "gpu" or (given.scale in LARGE_GPU_SCALES and given.device == "auto")
    cost = costs.cost_of(scale, configs, costs.measured_gflops(cores()), gpu)
    steps = steps_of(scale, configs, cost, folder)
    done = finished(steps, folder)
    print(_plan(given.scale, scale, configs, cost, steps, done, folder, gpu), flush=True)
    if given.estimate:
        return 0
    costs.require_disk(cost, folder)
    with claimed(folder):
        return _go_on(steps, finished(steps, folder), folder, next(iter(configs.values())))


def _plan(
    name: str,
    scale: "Scale",
    configs: "Mapping[str, Config]",
    cost: "Cost",
    steps: "Sequence[Step]",
    done: Sequence[bool],
    folder: Path,
    gpu: bool,
) -> str:
    """What will be done, and what it takes."""
    from dronecombat_jax.config.estimates import bytes_in_words
    from dronecombat_jax.runs.rate import count_text, duration_text

    config = next(iter(configs.values()))
    left = sum(step.seconds for step, over in zip(steps, done, strict=True) if not over)
    where = "one large GPU" if gpu else "this processor"
    return "\n".join(
        [
            f"reproduce {name} in {folder}: {scale.about}",
            f"  {' and '.join(configs)}, {scale.seeds} seeds each x {scale.chunks} chunks of "
            f"{count_text(config.steps_per_chunk)} steps: {count_text(cost.steps)} steps in all",
            f"  about {count_text(cost.fights)} fights: each run's own "
            f"{scale.chunks} x {scale.chunks}, all runs' every {scale.every} chunks, scripted pilots",
            f"  estimate for {where}: {duration_text(cost.seconds)} (trainings "
            f"{duration_text(sum(cost.trainings.values()))}, tournament {duration_text(cost.tournament)}, report "
            f"{duration_text(cost.report)}), memory {bytes_in_words(cost.memory)}, disk "
            f"{bytes_in_words(cost.disk)}",
            f"  {sum(done)} of {len(steps)} steps are finished, about {duration_text(left)} to go",
        ]
    )


def _go_on(steps: "Sequence[Step]", done: Sequence[bool], folder: Path, config: "Config") -> int:
    """Do the steps that are not done; returns the exit code of the first that stops."""
    from dronecombat_jax.cli.reproduction import note_finished
    from dronecombat_jax.machine.start import prepare_training
    from dronecombat_jax.runs.overall import Overall

    overall = Overall([step.seconds for step in steps], done)
    if not all(done):
        prepare_training(config)  # the devices of the trainings serve the other steps, too
    for number, step in enumerate(steps):
        if done[number]:
            continue
        print(f"{step.name}: {overall.text(number)}", flush=True)
        with overall.at(number):
            code = step.work()
        if code:
            return code
        note_finished(step, folder)
        overall.finish(number)
    print(f"finished: {steps[-1].output}", flush=True)
    return 0
