"""The reader that needs NumPy alone."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from policies import assert_same_actions, make_info, make_policy, observations
from policy_files import write

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.files import tensorfile
from dronecombat_jax.learn.memory import memory_size
from dronecombat_jax.learn.rollout import policy_mean, policy_step
from dronecombat_jax.policies import numpy_policy
from dronecombat_jax.policies.file import load_policy, save_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy


@pytest.mark.parametrize("normalize", [True, False])
@pytest.mark.parametrize("sizes", [(35, 256, 128, 4), (35, 7, 4)])
def test_numpy_alone_gives_the_same_actions(path, sizes, normalize):
    policy = make_policy(sizes, seed=2)
    save_policy(path, policy, make_info(layer_sizes=sizes, normalize_observations=normalize))
    alone = NumpyPolicy(path)
    ours = jax.jit(
        lambda seen: policy_mean(LearnConfig(normalize_observations=normalize), policy, seen)
    )
    for spread in (1.0, 4.0, *((1e4, 1e30) if normalize else ())):
        # 4: some parts are clipped; 1e4: nearly all
        seen = observations(policy, spread, normalize)
        assert_same_actions(alone(seen), np.asarray(ours(seen)))
        assert_same_actions(
            np.stack([alone(one) for one in seen[:20]]), np.asarray(ours(seen))[:20]
        )
    assert alone(np.zeros(35)).shape == (4,) and alone(np.zeros(35)).dtype == np.float32


@pytest.mark.parametrize("normalize", [True, False])
@pytest.mark.parametrize("memory", ["frames 3", "gru 12"])
def test_numpy_alone_remembers_what_the_policy_remembers(path, memory, normalize):
    """Step by step, fights side by side and one alone, and again after it has forgotten."""
    policy = {
        "frames 3": make_policy((3 * 35, 8, 4), seed=2, frames=3),
        "gru 12": make_policy((35 + 12, 8, 4), seed=2, state=12),
    }[memory]
    info = make_info(layer_sizes=(35, 8, 4), memory=memory)
    save_policy(path, policy, info._replace(normalize_observations=normalize))
    assert jax.tree.all(jax.tree.map(np.array_equal, load_policy(path).policy, policy))
    alone, learn = NumpyPolicy(path), LearnConfig(normalize_observations=normalize)
    assert alone.about["memory"] == memory and alone.about["format_version"] == "2"
    seen = observations(policy, 1.0, normalize).reshape(32, 8, 35)
    recall, wanted = jnp.zeros((8, memory_size(policy))), []
    step = jax.jit(lambda seen, recall: policy_step(learn, policy, seen, recall))
    for now in seen:
        mean, recall = step(now, recall)
        wanted.append(np.asarray(mean))
    assert_same_actions(np.stack([alone(now) for now in seen]), np.stack(wanted))
    assert np.abs(alone(seen[0]) - wanted[0]).max() > 1e-3  # another fight is remembered
    alone.reset()
    flown = np.stack([alone(now) for now in seen[:, 3]])
    assert_same_actions(flown, np.stack(wanted)[:, 3])


def test_the_clip_acts_on_far_observations(path):
    save_policy(path, make_policy(), make_info())
    alone, seen = NumpyPolicy(path), np.full(35, 1e6)
    assert np.array_equal(alone(seen), alone(seen * 10)) and not np.array_equal(
        alone(seen), alone(-seen)
    )


@pytest.mark.parametrize("shape", [(), (1,), (34,), (35, 1), (2, 36)])
def test_numpy_alone_refuses_observations_of_another_size(path, shape):
    save_policy(path, make_policy(), make_info())
    with pytest.raises(ValueError, match="its last axis must be 35 long"):
        NumpyPolicy(path)(np.zeros(shape))


def test_numpy_alone_refuses_other_files(path):
    for content in (
        bytes(200),
        b"\x80\x04" + b"\xff" * 200,
        tensorfile.encode({}, {"format": "pt"}),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError):
            NumpyPolicy(path)
    with pytest.raises(ValueError, match="NaN or infinity"):
        NumpyPolicy(write(path, {"log_std": np.full(4, np.inf, np.float32)}))


def test_the_file_for_the_robot_stands_alone(tmp_path, path):
    source = Path(numpy_policy.__file__)
    tree = ast.parse(source.read_text())
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    assert imported == {"json", "struct", "numpy"} and not [
        n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)
    ]
    save_policy(path, make_policy(), make_info())
    shutil.copy(source, tmp_path / "numpy_policy.py")
    code = (
        "import sys, numpy as np\n"
        "from numpy_policy import NumpyPolicy\n"
        f"print(NumpyPolicy({path.name!r})(np.arange(35.0)).tolist())\n"
        "assert not {'jax', 'dronecombat_jax', 'safetensors'} & set(sys.modules)"
    )
    # the same bits
    kernels = {name: value for name, value in os.environ.items() if name.startswith("OPENBLAS")}
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env=kernels
    )
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == NumpyPolicy(path)(np.arange(35.0)).tolist()
