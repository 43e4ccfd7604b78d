"""`dronecombat export`: one policy out of a run's checkpoint into one file: safetensors, ONNX or a
C header by its suffix.
"""

import hashlib
import re
from pathlib import Path

import jax

from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.observe import OBSERVATIONS, observation_of
from dronecombat_jax.config import settings
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.files.versions import package_version
from dronecombat_jax.learn.mates import only
from dronecombat_jax.policies.c_header import save_c
from dronecombat_jax.policies.file import refuse_overwriting, save_policy
from dronecombat_jax.policies.info import PolicyInfo, memory_of
from dronecombat_jax.policies.onnx import require_onnx, save_onnx
from dronecombat_jax.runs.evaluation import SavedRun, load_run, policies
from dronecombat_jax.types import ACTION_SIZE, SIDES, Policy, SidePolicy, TeamPolicy


def export(
    path: Path,
    out: Path,
    role: str,
    *,
    chunk: int | None = None,
    seed: int | None = None,
    drone: int = 0,
    force: bool = False,
) -> int:
    """Write the policy of `role` from the run at `path` to `out`; returns 0.

    `chunk` 0 is untrained, None the newest; `seed` may be None where the run has one alone; `drone`:
    whose policy alone, from 1, where each drone of the side has its own, 0 for all of them.
    Raises UserError: 2 for a seed, role or drone that the run lacks, 3 for a checkpoint, 73 for
    `out`.
    """
    refuse_overwriting(out, force)
    if out.suffix == ".onnx":
        require_onnx()
    run = load_run(path, chunk)
    policy, info = policy_of_run(run, RunDirectory(path), role, seed)
    if drone:
        policy, info = _of_drone(policy, info, drone)
    if save := {".onnx": save_onnx, ".h": save_c}.get(out.suffix):
        save(out, only(policy, one_line(out.name)), info, force=force)
    else:
        save_policy(out, policy, info, force=force)
    print(
        f"{out}: {_whose(info)} of {info.run}, seed {info.seed}, chunk {info.chunk} ({info.steps:,} environment steps), "
        f"network {'-'.join(map(str, info.layer_sizes))}, {out.stat().st_size:,} bytes"
    )
    return 0


def policy_of_run(
    run: SavedRun, directory: RunDirectory, role: str, seed: int | None
) -> tuple[SidePolicy, PolicyInfo]:
    """One side's policy of a run (NumPy leaves) and where it comes from."""
    config = run.config
    if config.game.observation not in OBSERVATIONS:
        raise UserError(
            f"{directory.path} sees by {config.game.observation}: a file is for "
            f"{' or '.join(OBSERVATIONS)} alone, which others can fly",
            EXIT_CONFIG,
        )
    if not game_of(config).flies[SIDES.index(role)]:
        raise UserError(
            f"{directory.path} is a {config.game.scenario} run: its {role} never flew; take the other --role",
            EXIT_CONFIG,
        )
    if run.frozen[SIDES.index(role)] is not None:
        raise UserError(
            f"{directory.path} trained against a {role} that does not learn: take the other --role",
            EXIT_CONFIG,
        )
    index = _seed_index(run, directory, seed)
    policy = policies(run, index)[SIDES.index(role)]
    info = PolicyInfo(
        role=role,
        layer_sizes=(
            observation_of(config).size,
            *config.learn.hidden_sizes,
            ACTION_SIZE,
        ),
        normalize_observations=config.learn.normalize_observations,
        environment=run.met,
        run=_identifier(directory.path.resolve().name),
        seed=config.train.seed + index,
        chunk=run.iteration // config.train.chunk_iterations,
        steps=run.iteration * config.steps_per_iteration,
        package_version=package_version(),
        jax_version=jax.__version__,
        config_sha256=hashlib.sha256(settings.to_toml(config).encode()).hexdigest(),
        memory=memory_of(config.learn),
        others_size=config.learn.others_size if config.learn.others == "mean" else 0,
        mates=len(policy.mates) if isinstance(policy, TeamPolicy) else 1,
    )
    return policy, info


def _of_drone(policy: SidePolicy, info: PolicyInfo, drone: int) -> tuple[Policy, PolicyInfo]:
    """The policy of one drone alone, `drone` from 1."""
    if not isinstance(policy, TeamPolicy):
        raise UserError(
            f"--drone {drone}: every {info.role} of {info.run} flies one policy: leave it out",
            EXIT_CONFIG,
        )
    if drone > info.mates:
        raise UserError(
            f"--drone {drone}: {info.run} has {info.role}s 1 to {info.mates}", EXIT_CONFIG
        )
    return policy.mates[drone - 1], info._replace(mates=1, drone=drone)


def _whose(info: PolicyInfo) -> str:
    if info.drone:
        return f"{info.role} {info.drone} alone"
    return f"{info.mates} {info.role}s with a policy each" if info.mates > 1 else info.role


def _seed_index(run: SavedRun, directory: RunDirectory, seed: int | None) -> int:
    first, count = run.config.train.seed, run.config.train.num_seeds
    if seed is None and count == 1:
        return 0
    if seed is None or not first <= seed < first + count:
        present = f"seed {first} alone" if count == 1 else f"seeds {first} to {first + count - 1}"
        asked = "choose one with --seed" if seed is None else f"not --seed {seed}"
        raise UserError(f"{directory.path} has {present}: {asked}", EXIT_CONFIG)
    return seed - first


def _identifier(name: str) -> str:
    """A folder's name with everything but plain characters replaced: it goes into messages and
    tables.
    """
    return re.sub(r"[^A-Za-z0-9._-]", "-", name)[:100].lstrip(".") or "run"
