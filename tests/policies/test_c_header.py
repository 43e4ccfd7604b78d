"""The C header flies as the policy does, compiled by gcc as strict C99."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from policies import make_info, make_policy, observations

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.policies.c_header import TOLERANCE, header_of, save_c
from dronecombat_jax.policies.file import save_policy
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
