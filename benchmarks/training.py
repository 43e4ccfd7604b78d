"""Training and fighting at the paper's settings, by the programs that `dronecombat` runs, and what
an iteration is made of.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchmarks.size import Scope, Size
from benchmarks.worker import Part, Program, peak_mib


def ippo(size: Size, num_seeds: int) -> Part:
    """An iteration of IPPO, then its pieces as programs of their own: flight, physics, policies,
    learning.
    """
    part = iteration(size, num_seeds)
    import jax

    from benchmarks import pieces
    from benchmarks.compiling import add, place, spread
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.runs.program import seed_devices
    from dronecombat_jax.selfplay.chunk import build_flight, init_state

    config = size.config(num_seeds)
    combat, mesh, work = Combat(config), seed_devices(config), part.programs[0].work
    add(
        part,
        "flight",
        work,
        build_flight(combat, 1, mesh),
        place(jax.jit(lambda: init_state(combat))(), mesh),
    )
    for name, build in pieces.PIECES.items():
        piece, arguments = build(combat)
        add(
            part,
            name,
            work,
            spread(piece, mesh),
            *place(pieces.for_seeds(arguments, num_seeds), mesh),
        )
    return part


def iteration(size: Size, num_seeds: int | None = None) -> Part:
    """An iteration of IPPO for `num_seeds` seeds (None: those of `size`), and what it takes of
    memory.

    Seeds are spread over devices as `dronecombat train` spreads them. Steps are summed over all
    seeds.
    """
    config = size.config(num_seeds or size.seeds)
    devices = _prepare(config)
    import jax

    from benchmarks.compiling import compile_timed, place
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.runs.program import seed_devices
    from dronecombat_jax.selfplay.chunk import build_advance, init_state

    combat, mesh = Combat(config), seed_devices(config)
    kind = jax.devices()[0].device_kind
    part = Part(facts={"devices": devices, "kind": kind, "num_seeds": config.train.num_seeds})
    state = [place(jax.jit(lambda: init_state(combat))(), mesh)]
    advance = compile_timed(
        part, "iteration", build_advance(combat, 1, mesh), state[0], donate=(0,)
    )

    def iterate() -> None:
        state[0], _ = jax.block_until_ready(advance(state[0]))

    work = config.train.num_seeds * config.steps_per_iteration
    part.programs.append(Program("iteration", "steps/s", work, iterate))
    iterate()
    part.peak_mib = peak_mib()
    return part


def sippo(size: Size, scope: Scope = "chunk", chunk_starts: bool = False) -> Part:
    """An iteration of S-IPPO: live, where both learn, and frozen, where the defender meets the past
    and learns alone.

    `chunk_starts`: also a live one that begins a chunk, and so saves both players to the pool and
    draws who is met.
    """
    config = size.config(probability=0.2, scope=scope)
    _prepare(config)
    import jax
    import jax.numpy as jnp

    from benchmarks.compiling import compile_timed
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.selfplay.chunk import build_advance, init_state
    from dronecombat_jax.selfplay.pool import NOBODY
    from dronecombat_jax.types import ATTACKER

    combat = Combat(config)
    part = Part(facts={"pool": config.num_chunks, "probability": config.selfplay.probability})
    state = [jax.jit(lambda: init_state(combat))()]
    advance = compile_timed(part, "iteration", build_advance(combat, 1), state[0], donate=(0,))
    past = jnp.arange(size.num_envs, dtype=jnp.int32)[None] % (
        1 if scope == "chunk" else config.num_chunks
    )

    def program(name: str, iteration: int, frozen: int) -> Program:
        def call() -> float:
            # The same program flies all kinds: inside a chunk, iteration 1, nothing is drawn anew.
            met = jnp.full_like(past, NOBODY) if frozen == NOBODY else past + 0
            selfplay = state[0].selfplay.replace(
                frozen=jnp.full((1,), frozen, jnp.int32), opponent=met
            )
            begun = state[0].replace(
                iteration=jnp.full((1,), iteration, jnp.int32), selfplay=selfplay
            )
            start = time.perf_counter()
            state[0], _ = jax.block_until_ready(advance(jax.block_until_ready(begun)))
            return time.perf_counter() - start

        return Program(name, "steps/s", config.steps_per_iteration, call)

    first = program("live, first of a chunk", 0, NOBODY)
    first.call()  # there must be a past player in the pool
    part.programs = [
        program("live", 1, NOBODY),
        program("frozen", 1, ATTACKER),
        *([first] if chunk_starts else []),
    ]
    return part


def tournament(size: Size) -> Part:
    """A round robin of untrained policies, in fights and in environment steps; compiling does not
    count.
    """
    config = size.config()
    _prepare(config)
    import jax

    from dronecombat_jax.arena.players import Player
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.arena.round_robin import play
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.learn.ippo import init_learner
    from dronecombat_jax.learn.rollout import policy_of

    combat, part = Combat(config), Part()
    draw = jax.jit(jax.vmap(lambda key: policy_of(init_learner(key, config.learn))))
    drawn = jax.device_get(draw(jax.random.split(jax.random.key(0), 2 * size.players)))
    pick = lambda i: jax.tree.map(lambda leaf: leaf[i], drawn)
    everybody = [Player(f"player {i}", pick(i)) for i in range(2 * size.players)]
    sides = everybody[: size.players], everybody[size.players :]
    steps: list[int] = []

    def call() -> float:
        begun: list[float] = []

        @contextmanager
        def timed(what: str) -> Iterator[None]:
            start = time.perf_counter()
            yield
            begun.append(time.perf_counter())
            part.compile_seconds.setdefault("fight", begun[-1] - start)

        flown = [
            cell
            for harvest in play(combat, *sides, Rules(size.episodes), compiling=timed)
            for cell in harvest.cells
        ]
        steps.append(sum(int(cell.steps.sum()) for cell in flown))
        return time.perf_counter() - begun[0]

    call()  # the fights are the same every time: now their length is known
    fights = size.players**2 * size.episodes
    part.facts = {"players": size.players, "fights": fights, "steps_per_fight": steps[0] / fights}
    part.programs.append(Program("fights", "steps/s", steps[0], call))
    return part


def _prepare(config: Any) -> int:
    """Set JAX up as `dronecombat train` does; the number of devices."""
    from dronecombat_jax.config.devices import spread
    from dronecombat_jax.machine import backend

    devices = spread(config.train.num_seeds, config.run.devices, backend.cores())
    backend.prepare(config.run.device, devices)
    return devices
