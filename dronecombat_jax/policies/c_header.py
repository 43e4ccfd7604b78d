"""One policy as a C99 header: weights, one function, a self-test; no allocation, no library but
math.h.

What does not live here: what must be around it on a drone (docs/how_to/real_drone.md).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.learn.normalize import CLIP, EPSILON
from dronecombat_jax.policies.c_scales import scales
from dronecombat_jax.policies.file import refuse_more_than_layers, refuse_overwriting
from dronecombat_jax.policies.info import PolicyInfo, metadata_of
from dronecombat_jax.types import ACTION_SIZE, Policy

TESTS = 4  # observations of the self-test
TOLERANCE = 1e-5  # of an action as flown; float32 sums depend on their order
RUN = 16  # products in a partial sum
_FLOATS_A_LINE = 8

_CODE = """
/* Products of two rows of `count` numbers, added up in short runs, so that few are rounded together. */
static inline float dronecombat_product(const float *a, const float *b, int count)
{{
    float sum = 0.0f;
    for (int first = 0; first < count; first += {run}) {{
        const int end = first + {run} < count ? first + {run} : count;
        float part = 0.0f;
        for (int i = first; i < end; ++i) part += a[i] * b[i];
        sum += part;
    }}
    return sum;
}}

/* The action [{actions}] in [-1, 1] for an observation [{inputs}] of finite numbers, in SI units. */
static inline void dronecombat_policy(const float *observation, float *action)
{{
    DRONECOMBAT_BUFFERS float a[{widest}], b[{widest}];
    for (int i = 0; i < {inputs}; ++i) {{
{scaling}
    }}
{layers}
    for (int i = 0; i < {actions}; ++i)
        action[i] = fminf(fmaxf({last}[i], -1.0f), 1.0f);
}}

/* The largest difference from the expected actions; at most DRONECOMBAT_TOLERANCE where all is well. */
static inline float dronecombat_self_test(void)
{{
    float worst = 0.0f, action[{actions}];
    for (int test = 0; test < {tests}; ++test) {{
        dronecombat_policy(dronecombat_test_observation + test * {inputs}, action);
        for (int i = 0; i < {actions}; ++i) {{
            const float off = fabsf(action[i] - dronecombat_test_action[test * {actions} + i]);
            if (!(off <= worst)) worst = off;
        }}
    }}
    return worst;
}}

#endif
"""

_SCALED = """        const float x = (observation[i] - dronecombat_mean[i]) / dronecombat_scale[i];
        a[i] = fminf(fmaxf(x, -{clip}f), {clip}f);"""

_LAYER = """    for (int o = 0; o < {outputs}; ++o) {{
        const float *row = dronecombat_weights_{layer} + o * {inputs};
        const float sum = dronecombat_product({source}, row, {inputs}) + dronecombat_biases_{layer}[o];
        {target}[o] = {value};
    }}"""


def save_c(path: Path, policy: Policy, info: PolicyInfo, *, force: bool = False) -> None:
    """Write one policy as a header; `log_std` is not in it.

    Raises UserError: 73 where `path` exists (without `force`) or the disk refuses, 2 for a policy
    with memory or an encoder of others.
    """
    refuse_more_than_layers(path, info)
    refuse_overwriting(path, force)
    write_atomic(path, header_of(policy, info))


def header_of(policy: Policy, info: PolicyInfo) -> str:
    """The text of the header; the same policy gives the same text."""
    observations = _observations(policy, info)
    sizes = info.layer_sizes
    layers = len(sizes) - 1
    names = ("a", "b")
    code = _CODE.format(
        inputs=sizes[0],
        actions=ACTION_SIZE,
        widest=max(sizes),
        tests=TESTS,
        run=RUN,
        scaling=_SCALED.format(clip=CLIP)
        if info.normalize_observations
        else "        a[i] = observation[i];",
        layers="\n".join(
            _LAYER.format(
                layer=layer,
                inputs=sizes[layer],
                outputs=sizes[layer + 1],
                source=names[layer % 2],
                target=names[1 - layer % 2],
                value="sum" if layer == layers - 1 else "sum > 0.0f ? sum : expm1f(sum)",
            )
            for layer in range(layers)
        ),
        last=names[layers % 2],
    )
    arrays = dict(_arrays(policy, info))
    arrays["test_observation"] = observations
    arrays["test_action"] = np.clip(_actions(policy, info, observations), -1.0, 1.0)
    return "\n".join([*_opening(info), *(_array(*item) for item in arrays.items())]) + code


def _opening(info: PolicyInfo) -> Iterator[str]:
    """The card as a comment, the guard and the constants."""
    yield "/* A policy of dronecombat-jax; made by dronecombat export. Never flown on hardware."
    yield " * Quaternions are wxyz; positions m, velocities m/s, rates rad/s; x forwards, z up."
    for key, text in metadata_of(info).items():
        yield f" * {key}: {text.replace('*/', '* /')}"
    yield " */"
    yield "#ifndef DRONECOMBAT_POLICY_H\n#define DRONECOMBAT_POLICY_H\n#include <math.h>\n"
    yield f"#define DRONECOMBAT_OBSERVATION_SIZE {info.layer_sizes[0]}"
    yield f"#define DRONECOMBAT_ACTION_SIZE {ACTION_SIZE}"
    yield f"#define DRONECOMBAT_CONTROL_DT {info.control_dt!r}f /* s between two calls */"
    yield f"#define DRONECOMBAT_TOLERANCE {TOLERANCE!r}f"
    yield from scales(info)
    yield "/* Define it as static where a task's stack is small; then no two tasks may call at once. */"
    yield "#ifndef DRONECOMBAT_BUFFERS\n#define DRONECOMBAT_BUFFERS\n#endif\n"


def _arrays(policy: Policy, info: PolicyInfo) -> Iterator[tuple[str, np.ndarray]]:
    if info.normalize_observations:
        yield "mean", np.asarray(policy.observation_scaler.mean)
        yield "scale", _scale(policy)
    pairs = zip(policy.network.weights, policy.network.biases, strict=True)
    for layer, (weights, biases) in enumerate(pairs):
        yield f"weights_{layer}", np.asarray(weights).T  # [out, in]
        yield f"biases_{layer}", np.asarray(biases)


def _array(name: str, values: np.ndarray) -> str:
    """An array as C spells it, exactly: hexadecimal floats."""
    flat = [f"{float(value).hex()}f" for value in np.asarray(values, np.float32).ravel()]
    rows = [", ".join(flat[i : i + _FLOATS_A_LINE]) for i in range(0, len(flat), _FLOATS_A_LINE)]
    body = ",\n    ".join(rows)
    return f"static const float dronecombat_{name}[{len(flat)}] = {{\n    {body}\n}};"


def _scale(policy: Policy) -> np.ndarray:
    variance = np.asarray(policy.observation_scaler.variance)
    return np.sqrt(variance) + np.float32(EPSILON)


def _observations(policy: Policy, info: PolicyInfo) -> np.ndarray:
    """Random observations [TESTS, 35] such as the policy has seen, the same each time."""
    drawn = np.random.default_rng(0).normal(size=(TESTS, info.layer_sizes[0]))
    if info.normalize_observations:
        drawn = np.asarray(policy.observation_scaler.mean) + drawn * _scale(policy)
    return drawn.astype(np.float32)


def _actions(policy: Policy, info: PolicyInfo, observations: np.ndarray) -> np.ndarray:
    """Mean actions [..., 4] in double precision."""
    x = observations.astype(np.float64)
    if info.normalize_observations:
        x = np.clip((x - np.asarray(policy.observation_scaler.mean)) / _scale(policy), -CLIP, CLIP)
    pairs = list(zip(policy.network.weights, policy.network.biases, strict=True))
    for layer, (weights, biases) in enumerate(pairs):
        x = x @ np.asarray(weights, np.float64) + np.asarray(biases)
        if layer < len(pairs) - 1:
            x = np.where(x > 0, x, np.expm1(np.minimum(x, 0)))
    return x
