"""The C header flies as the policy does, compiled by gcc as strict C99."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from policies import make_info, make_policy, observations

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.learn.mates import only
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.c_header import TOLERANCE, header_of, save_c
from dronecombat_jax.policies.file import load_policy, save_policy
from dronecombat_jax.policies.numpy_policy import NumpyPolicy

SIZES = (35, 64, 32, 4)
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2")
PROGRAM = """
#include <stdio.h>
#include "policy.h"
int main(void) {
    float seen[DRONECOMBAT_OBSERVATION_SIZE], action[DRONECOMBAT_ACTION_SIZE];
    printf("%.9g\\n", (double)dronecombat_self_test());
    while (fread(seen, sizeof seen, 1, stdin) == 1) {
        dronecombat_policy(seen, action);
        for (int i = 0; i < DRONECOMBAT_ACTION_SIZE; ++i) printf("%.9g\\n", (double)action[i]);
    }
    return 0;
}
"""


def compiled(folder: Path, header: str) -> Path:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed")
    (folder / "policy.h").write_text(header)
    (folder / "main.c").write_text(PROGRAM)
    line = [gcc, *STRICT, str(folder / "main.c"), "-o", str(folder / "fly"), "-lm"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder / "fly"


def answers(program: Path, seen: np.ndarray) -> np.ndarray:
    given = np.ascontiguousarray(seen, "<f4").tobytes()
    out = subprocess.run([program], input=given, capture_output=True, timeout=60, check=True)
    return np.array(out.stdout.split(), float)


@pytest.mark.parametrize("normalize", [True, False])
def test_gcc_gives_the_actions_of_numpy(tmp_path: Path, normalize: bool):
    policy = make_policy(SIZES)
    info = make_info(layer_sizes=SIZES, normalize_observations=normalize)
    save_policy(tmp_path / "a.safetensors", policy, info)
    program = compiled(tmp_path, header_of(policy, info))
    for spread in (1.0, 4.0):
        seen = observations(policy, spread, normalize)
        first, *rest = answers(program, seen)
        assert first <= TOLERANCE
        ours = np.clip(NumpyPolicy(tmp_path / "a.safetensors")(seen), -1.0, 1.0)
        np.testing.assert_allclose(np.reshape(rest, (-1, 4)), ours, atol=2e-6)
        assert np.abs(ours).min() < 0.9  # not all at the limits


@pytest.mark.parametrize("name", ["ippo-attacker-34", "ippo-defender-34", "sippo-attacker-34"])
def test_trained_pilots_are_within_a_millionth_of_numpy_in_double_precision(
    tmp_path: Path, name: str
):
    """10,000 observations about what they have seen. NumPy's own float32 is not so near (2e-6)."""
    (file,) = shipped.paths(name)
    saved, info = load_policy(file)
    policy = only(saved, "a header")
    program = compiled(tmp_path, header_of(policy, info))
    scaler, random = policy.observation_scaler, np.random.default_rng(0)
    spread = np.sqrt(np.asarray(scaler.variance))
    seen = np.asarray(scaler.mean) + spread * random.normal(size=(10_000, len(spread)))
    seen = seen.astype(np.float32)
    exact = NumpyPolicy(file)
    exact.layers = [(weight.astype(float), bias.astype(float)) for weight, bias in exact.layers]
    exact.mean, exact.scale = exact.mean.astype(float), exact.scale.astype(float)
    actions = np.clip(exact(seen), -1.0, 1.0)
    assert actions.dtype == np.float64 and np.mean(np.abs(actions) < 1.0) > 0.1
    np.testing.assert_allclose(np.reshape(answers(program, seen)[1:], (-1, 4)), actions, atol=1e-6)


def test_buffers_may_be_static(tmp_path: Path):
    policy, info = make_policy(SIZES), make_info(layer_sizes=SIZES)
    header = header_of(policy, info)
    seen = observations(policy, 1.0, True)[:50]
    first = answers(compiled(tmp_path, header), seen)
    static = "#define DRONECOMBAT_BUFFERS static\n" + header
    np.testing.assert_array_equal(answers(compiled(tmp_path, static), seen), first)


def test_the_self_test_notices_a_changed_weight(tmp_path: Path):
    policy, info = make_policy(SIZES), make_info(layer_sizes=SIZES)
    right = header_of(policy, info)
    start = right.index("dronecombat_weights_2[")
    begin = right.index("\n", start) + 5
    end = right.index("f,", begin)
    broken = right[:begin] + "0x1.8p+3" + right[end:]
    assert answers(compiled(tmp_path, broken), np.zeros((0, 35)))[0] > TOLERANCE


def test_the_same_policy_gives_the_same_text_and_nothing_is_overwritten(tmp_path: Path):
    policy, info = make_policy(SIZES), make_info(layer_sizes=SIZES)
    save_c(tmp_path / "a.h", policy, info)
    text = (tmp_path / "a.h").read_text()
    assert text == header_of(policy, info) and f" * role: {info.role}\n" in text
    assert ' * action_fields: ["thrust"' in text
    with pytest.raises(UserError) as raised:
        save_c(tmp_path / "a.h", policy, info)
    assert raised.value.exit_code == EXIT_CANNOT_WRITE
