"""Programs kept between processes: the same bits, traced once, and traced anew whenever anything
they depend on differs.
"""

import os
import signal
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import jax
import pytest
import toy
from drones import write
from meshes import never

from dronecombat_jax import __main__
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, RunConfig, SelfPlayConfig
from dronecombat_jax.runs import lowered, signals
from dronecombat_jax.selfplay.chunk import build_advance, init_state
from dronecombat_jax.selfplay.mesh import place
from dronecombat_jax.types import RewardTerms

CONFIG = replace(toy.CONFIG, selfplay=SelfPlayConfig(probability=0.5))


@pytest.fixture(scope="module")
def start() -> SimpleNamespace:
    combat = toy.Coasting(CONFIG)
    state = jax.jit(lambda: init_state(combat), compiler_options=toy.UNOPTIMISED)()
    return SimpleNamespace(combat=combat, state=jax.device_get(state))


@pytest.fixture
def kept(monkeypatch, tmp_path, start) -> SimpleNamespace:
    """`run(**what)` compiles as a new process would, with `what` replaced, and calls; `builds`
    counts. It keeps programs once `keeps` is set.

    The program is a small one on a whole training state; `training` is the real one.
    """
    monkeypatch.setattr(lowered, "_began", None)
    monkeypatch.setenv("DRONECOMBAT_CACHE", str(tmp_path))
    builds: list[int] = []

    def small(state):
        report = RewardTerms(*[state.env.qpos * scale for scale in range(7)])
        return state.replace(iteration=state.iteration + 1), report

    def build_small():
        builds.append(1)
        return small

    def run(name="advance", config=CONFIG, build=build_small):
        if here.keeps:
            lowered.keep()
        state = place(start.state, None)
        options = {"compiler_options": toy.UNOPTIMISED, "donate_argnums": 0}
        program = lowered.compiled(name, config, build, state, None, **options)
        result = jax.device_get(program(state))
        assert jax.tree.leaves(state)[0].is_deleted()
        return result

    training = lambda: build_advance(start.combat, toy.CHUNK)
    here = SimpleNamespace(
        run=run,
        small=small,
        builds=builds,
        training=training,
        folder=tmp_path / "lowered",
        keeps=False,
    )
    return here


def test_nothing_is_kept_unless_the_process_is_a_command(kept):
    kept.run()
    kept.run()
    assert len(kept.builds) == 2 and not kept.folder.exists()


@pytest.fixture
def handlers():
    """Put back what signals do in this process: after a command they have the system's own action."""
    before = {number: signal.getsignal(number) for number in signals.STOP_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_command_keeps_programs_and_a_call_from_python_does_not(
    kept, capsys, monkeypatch, handlers
):
    monkeypatch.setattr(sys, "argv", ["dronecombat", "--help"])
    assert cli.main() == 0 and lowered._began is None
    assert __main__.main() == 0 and lowered._began is not None


def test_a_kept_program_is_not_traced_again(kept):
    expected = kept.run()
    kept.keeps = True
    toy.assert_same_bits(kept.run(), expected)
    toy.assert_same_bits(kept.run(), expected)
    assert len(kept.builds) == 2  # without keeping, and to keep it


@pytest.mark.slow
def test_a_kept_training_program_learns_the_same_bits(kept):
    expected = kept.run(build=kept.training)
    kept.keeps = True
    kept.run(build=kept.training)
    again = kept.run(build=never)
    toy.assert_same_bits(again, expected)
    assert jax.tree.structure(again) == jax.tree.structure(expected)


def test_another_program_another_setting_or_another_variable_is_another_file(kept, monkeypatch):
    kept.keeps = True
    kept.run()
    kept.run(name="flight")
    kept.run(config=replace(CONFIG, learn=replace(CONFIG.learn, discount=0.9)))
    monkeypatch.setenv("JAX_DEFAULT_MATMUL_PRECISION", "float32")
    kept.run()
    assert len(kept.builds) == len(list(kept.folder.iterdir())) == 4


def test_runs_that_differ_in_name_seed_and_length_share_a_file(kept):
    kept.keeps = True
    kept.run()
    elsewhere = RunConfig(name="other", directory="/nowhere", figures=False)
    kept.run(
        config=replace(
            CONFIG, run=elsewhere, train=replace(CONFIG.train, seed=9, total_steps=10**9)
        )
    )
    assert len(kept.builds) == 1


@pytest.mark.long
def test_name_seed_and_length_are_not_in_the_program(start):
    def text(config):
        advance = build_advance(toy.Coasting(config), toy.CHUNK)
        return jax.jit(advance).lower(start.state).as_text()

    other = replace(
        CONFIG, run=RunConfig(name="other"), train=replace(CONFIG.train, seed=9, total_steps=10**9)
    )
    assert text(other) == text(CONFIG)


@pytest.mark.parametrize("share", ["settle_share", "average_share"])
def test_where_learning_settles_or_is_averaged_the_length_is_in_the_key(start, share):
    def key(config: Config, steps: int) -> str:
        train = replace(config.train, total_steps=steps)
        return lowered._key(replace(config, train=train), start.state, None)

    settling = replace(CONFIG, learn=replace(CONFIG.learn, **{share: 0.5}))
    assert key(CONFIG, 400) == key(CONFIG, 800)
    assert key(settling, 400) != key(settling, 800)


@pytest.fixture
def source(monkeypatch, tmp_path) -> Path:
    """A file of code that the process has loaded."""
    path = tmp_path / "plugin.py"
    path.write_text("SCALE = 1.0\n")
    module = ModuleType("plugin")
    module.__file__ = str(path)
    monkeypatch.setitem(sys.modules, "plugin", module)
    return path


@pytest.mark.parametrize("change", ("longer", "touched", "gone"))
def test_a_file_of_code_that_has_changed_makes_it_trace_again(kept, source, change):
    kept.keeps = True
    kept.run()
    if change == "longer":
        source.write_text("SCALE = 10.0\n")
    elif change == "touched":
        os.utime(source, (1, 1))
    else:
        source.unlink()
    kept.run()
    assert len(kept.builds) == 2
    kept.run()
    assert len(kept.builds) == 2 and len(list(kept.folder.iterdir())) == 1


def test_a_program_whose_code_was_edited_while_it_was_traced_is_not_kept(kept, source):
    kept.keeps = True
    kept.run(build=lambda: source.write_text("SCALE = 10.0\n") and kept.small)
    assert not kept.folder.exists()
    kept.run()
    assert len(list(kept.folder.iterdir())) == 1


def test_it_depends_on_the_package_the_scene_and_the_libraries():
    assert callable(Combat(CONFIG)._fly)  # as tracing a flight does: it loads MJX
    files = {Path(file).name for file in lowered._files(CONFIG)}
    assert {
        "ippo.py",
        "chunk.py",
        "flight.py",
        "lowered.py",
        "combat.xml",
        "crazyflie.xml",
    } <= files
    for library in ("jax", "mujoco/mjx", "flax", "optax"):
        assert any(f"/{library}/__init__.py" in file for file in lowered._files(CONFIG))


def test_it_depends_on_every_file_of_an_own_drone(tmp_path):
    """A mesh that is edited may be another inertia."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.stl").write_bytes(b"")
    named = '<compiler meshdir="meshes"/><asset><mesh file="hull.stl"/></asset>'
    main = write(tmp_path, '<mujoco><include file="parts.xml"/></mujoco>')
    write(tmp_path, f"<mujoco>{named}</mujoco>", name="parts.xml")
    config = replace(CONFIG, sim=replace(CONFIG.sim, mjcf=str(main)))
    assert {"drone.xml", "parts.xml", "hull.stl"} <= {
        Path(file).name for file in lowered._files(config)
    }


@pytest.mark.parametrize("damage", ("empty", "cut", "bit", "text", "list", "folder"))
def test_a_damaged_file_is_made_anew(kept, damage):
    kept.keeps = True
    expected = kept.run()
    (path,) = kept.folder.iterdir()
    whole = path.read_bytes()
    if damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        middle = len(whole) * 3 // 4
        path.write_bytes(
            {
                "empty": b"",
                "cut": whole[:middle],
                "bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
                "text": b"never a program\n",
                "list": b"[1]\n",
            }[damage]
        )
    toy.assert_same_bits(kept.run(), expected)
    kept.run()
    # a folder stays in the way, and training goes on
    assert len(kept.builds) == (3 if damage == "folder" else 2)


def test_where_nothing_can_be_written_training_goes_on(kept):
    kept.folder.write_text("a file in the folder's place")
    kept.keeps = True
    kept.run()
    kept.run()
    assert len(kept.builds) == 2


def test_what_cannot_be_exported_is_traced(kept, monkeypatch):
    def refuse(_):
        raise ValueError(
            "Cannot serialize code with custom calls whose targets have no compatibility guarantees"
        )

    monkeypatch.setattr("jax.export.export", refuse)
    kept.keeps = True
    kept.run()
    assert not kept.folder.exists()
