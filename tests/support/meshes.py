"""The toy run on several meshes, in a process of its own: devices are settled when JAX starts.
Writes `.npz` files.

    python meshes.py FOLDER

`start.npz`, the state that all begin with; `<seeds>x<environments>.npz`, two seeds after three
chunks of S-IPPO, with the metrics of all iterations below `curves/` (2x1 and 1x2 by a program from
a file, `runs.lowered`), and `together-<mesh>.npz`, the same with both seeds side by side;
`flight-<mesh>.npz`, but for 2x1, the fights after one rollout of policies that only draw noise, and
`flight-<mesh>.txt`, that flight's program.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dronecombat_jax.machine import backend

MESHES = ((1, 1), (2, 1), (1, 2), (1, 4), (2, 2))
TOGETHER = ((1, 1), (1, 2))
KEPT = ((2, 1), (1, 2))
ITERATIONS = 6


def never() -> Any:
    """In the place of a program's tracing, where it must not be traced."""
    raise AssertionError("traced again")


def main(folder: Path) -> None:
    """Every mesh in turn."""
    backend.prepare("cpu", 4)
    import jax
    from toy import CONFIG, UNOPTIMISED, Coasting

    from dronecombat_jax.config.fields import SelfPlayConfig
    from dronecombat_jax.files.arrays import flatten
    from dronecombat_jax.runs import lowered
    from dronecombat_jax.selfplay.chunk import build_advance, build_flight, init_state
    from dronecombat_jax.selfplay.mesh import device_mesh, jitted, place

    config = replace(
        CONFIG,
        # cut inside a time step: 6 x 16 transitions into 4, the defender's 6 x 8 too
        learn=replace(CONFIG.learn, minibatch_order="sequential", minibatches=4),
        selfplay=SelfPlayConfig(probability=1.0, scope="environment", roles="both"),
        train=replace(CONFIG.train, num_seeds=2, num_envs=16, solo_share=0.5, head_start_steps=0),
    )
    combat = Coasting(config)
    start = jax.device_get(jax.jit(lambda: init_state(combat), compiler_options=UNOPTIMISED)())
    np.savez(folder / "start.npz", **flatten(start))  # pyright: ignore[reportArgumentType]
    silent = jax.tree.map(np.zeros_like, start.learners.parameters)
    drawn = start.replace(learners=start.learners.replace(parameters=silent))
    together = Coasting(replace(config, run=replace(config.run, seeds_at_once=2)))

    def save_run(
        name: str, combat: Coasting, mesh: jax.sharding.Mesh | None, kept: bool = False
    ) -> None:
        advance, state = build_advance(combat, ITERATIONS, mesh), place(start, mesh)
        if kept:
            lowered.compiled(
                "advance", config, lambda: advance, state, mesh, compiler_options=UNOPTIMISED
            )
            program = lowered.compiled(
                "advance", config, never, state, mesh, compiler_options=UNOPTIMISED
            )
        else:
            program = jitted(advance, state, mesh, compiler_options=UNOPTIMISED)
        state, report = program(state)
        curves = {f"curves/{path}": leaf for path, leaf in flatten(report).items()}
        np.savez(folder / f"{name}.npz", **flatten(state), **curves)  # pyright: ignore[reportArgumentType]

    lowered.keep()
    for shape in MESHES:
        mesh = device_mesh(*shape) if shape != (1, 1) else None
        name = "x".join(map(str, shape))
        save_run(name, combat, mesh, kept=shape in KEPT)
        if shape in TOGETHER:
            save_run(f"together-{name}", together, mesh)
        if shape == (2, 1):
            continue  # no seed shares its environments, and no test compares this flight
        fly = jitted(build_flight(combat, 1, mesh), start, mesh, compiler_options=UNOPTIMISED)
        compiled = fly.lower(place(drawn, mesh)).compile()
        (folder / f"flight-{name}.txt").write_text(compiled.as_text())
        flown, _ = compiled(place(drawn, mesh))
        np.savez(folder / f"flight-{name}.npz", **flatten(flown.env))  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
