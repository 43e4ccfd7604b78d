"""Policy and value networks: plain functions on `MLP` and `Parameters`."""

import math

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.sight import GROUPS, OWN_SIZE, SLOT_SIZE
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn.recurrent import init_gru
from dronecombat_jax.types import ACTION_SIZE, MLP, OBSERVATION_SIZE, Encoder, Parameters

OTHERS = 1000  # what an encoder's key is folded from; layers count from 0
MEMORY = 1001  # the same of a GRU
# exp(r) - 1 - r over r^2, for |r| <= ln(2) / 2: the polynomial with the least largest error of exp
# (Remez), 3e-9.
EXPM1_TAIL = (0.5, 0.16666518, 0.041666206, 0.0083688898, 0.0013950494)


def init_mlp(key: jax.Array, sizes: tuple[int, ...], hidden_gain: float, output_gain: float) -> MLP:
    """Orthogonal weights, zero biases; `sizes` are the widths from input to output."""
    gains = [hidden_gain] * (len(sizes) - 2) + [output_gain]
    weights = tuple(
        jax.nn.initializers.orthogonal(gain)(
            jax.random.fold_in(key, i), (fan_in, fan_out), jnp.float32
        )
        for i, (gain, fan_in, fan_out) in enumerate(zip(gains, sizes[:-1], sizes[1:], strict=True))
    )
    return MLP(weights=weights, biases=tuple(jnp.zeros(size) for size in sizes[1:]))


def init_parameters(
    key: jax.Array,
    learn: LearnConfig,
    observation_size: int = OBSERVATION_SIZE,
    critic_size: int | None = None,
) -> Parameters:
    """One side's untrained policy and value; `critic_size`: inputs of the value where they are
    not the observation.
    """
    policy_key, value_key = jax.random.split(key)
    gru = None
    if learn.memory == "frames":
        observation_size *= learn.frames
    if learn.memory == "gru":
        gru = init_gru(jax.random.fold_in(policy_key, MEMORY), observation_size, learn.memory_size)
        observation_size += learn.memory_size
    seen = observation_size if critic_size is None else critic_size
    return Parameters(
        policy=_init_network(
            policy_key, learn, observation_size, ACTION_SIZE, learn.policy_output_gain
        ),
        log_std=jnp.full(ACTION_SIZE, learn.initial_log_std, jnp.float32),
        value=_init_network(
            value_key, learn, seen, 1, learn.hidden_gain, slots=critic_size is None
        ),
        gru=gru,
    )


def _init_network(
    key: jax.Array,
    learn: LearnConfig,
    inputs: int,
    outputs: int,
    output_gain: float,
    slots: bool = True,
) -> MLP:
    """A network of `learn.hidden_sizes`; with an encoder where `learn.others` asks for one and what
    it sees has `slots`.
    """
    encodes = slots and learn.others == "mean"
    inputs = encoded_size(learn.others_size) if encodes else inputs
    mlp = init_mlp(key, (inputs, *learn.hidden_sizes, outputs), learn.hidden_gain, output_gain)
    return mlp.replace(others=init_encoder(key, learn)) if encodes else mlp


def init_encoder(key: jax.Array, learn: LearnConfig) -> Encoder:
    """Orthogonal weights, zero biases; `key` as of the network that it stands before."""
    draw = jax.nn.initializers.orthogonal(learn.hidden_gain)
    shape = (len(GROUPS), SLOT_SIZE - 1, learn.others_size)
    weights = draw(jax.random.fold_in(key, OTHERS), shape, jnp.float32)
    return Encoder(weights=weights, biases=jnp.zeros((len(GROUPS), learn.others_size)))


def encoded_size(others_size: int) -> int:
    """Inputs of the first layer behind an encoder of `others_size` units."""
    return OWN_SIZE + len(GROUPS) * (others_size + 1)


def forward(mlp: MLP, x: jax.Array) -> jax.Array:
    """`x` [..., in] -> [..., out]; ELU between layers, none after the last."""
    return jnp.moveaxis(forward_columns(mlp, jnp.moveaxis(x, -1, 0)), 0, -1)


def forward_columns(mlp: MLP, x: jax.Array) -> jax.Array:
    """`x` [in, ...] -> [out, ...]: the same, features first.

    XLA's CPU products run at full rate in this layout in all three directions; batch first, the
    weights' gradient takes twice as long (docs/tuning.md).
    """
    if mlp.others is not None:
        x = encode(mlp.others, x)
    for weight, bias in zip(mlp.weights[:-1], mlp.biases[:-1], strict=True):
        x = elu(_affine(weight, bias, x))
    return _affine(mlp.weights[-1], mlp.biases[-1], x)


def encode(others: Encoder, x: jax.Array) -> jax.Array:
    """`x` [19 + G k 10, ...] of observation `nearest` -> [19 + G (E + 1), ...]: a drone's own state,
    and of each group the mean of what the layer makes of those who are seen, and 1; 0 where nobody is.

    So the order of a group's slots does not matter, nor how many there are (Deep Sets, Zaheer et al.
    2017). What stands in a slot without flag changes nothing.
    """
    own, slots = x[:OWN_SIZE], x[OWN_SIZE:]
    slots = slots.reshape(len(GROUPS), -1, SLOT_SIZE, *x.shape[1:])
    parts = [own]
    for weight, bias, group in zip(others.weights, others.biases, slots, strict=True):
        seen = jnp.asarray(group[:, -1] > 0.5)  # [k, ...]
        units = elu(_affine(weight, bias, jnp.moveaxis(group[:, :-1], 1, 0)))  # [E, k, ...]
        count = jnp.maximum(jnp.sum(seen, axis=0), 1)
        counted = jnp.where(seen, units, 0.0)
        parts.append(jnp.sum(jnp.asarray(counted), axis=1) / count)
        parts.append(jnp.any(seen, axis=0)[None].astype(x.dtype))
    return jnp.concatenate(parts)


@jax.custom_vjp
def elu(x: jax.Array) -> jax.Array:
    """x above 0, exp(x) - 1 below; float32.

    The gradient is computed from the output, so the backward pass needs no second exponential.
    """
    return jnp.where(x > 0.0, x, _expm1_below_zero(x))


def _expm1_below_zero(x: jax.Array) -> jax.Array:
    """exp(x) - 1 for float32 x up to 0, NaN for NaN: relative error 9e-8, on a CPU in 0.6 of the
    time of XLA's exp(x) - 1.

    (2^n - 1) + 2^n (exp(r) - 1), n the integer nearest to x / ln 2 and |r| <= ln(2) / 2 (Cody and
    Waite 1980).
    """
    x = jnp.where(x < -80.0, -80.0, x)  # 2^n stays a normal number; the result is -1 from -18 down
    n = jnp.round(x * (1.0 / math.log(2.0)))
    r = x - n * math.log(2.0)
    tail = jnp.full_like(r, EXPM1_TAIL[-1])
    for coefficient in EXPM1_TAIL[-2::-1]:
        tail = tail * r + coefficient
    # A float32 next to 1.5 * 2^23 has n in its lowest bits; 23 up it is the exponent of 2^n.
    bits = jax.lax.bitcast_convert_type(n + 1.5 * 2.0**23, jnp.int32)
    power = jax.lax.bitcast_convert_type((bits + 127) << 23, jnp.float32)
    return (tail * r * r + r) * power + (power - 1.0)


def _elu_forward(x: jax.Array) -> tuple[jax.Array, jax.Array]:
    y = elu(x)
    return y, y


def _elu_backward(y: jax.Array, cotangent: jax.Array) -> tuple[jax.Array]:
    return (jnp.where(y > 0.0, cotangent, cotangent * (y + 1.0)),)


elu.defvjp(_elu_forward, _elu_backward)


def _affine(weight: jax.Array, bias: jax.Array, x: jax.Array) -> jax.Array:
    return jnp.tensordot(weight, x, axes=(0, 0)) + bias.reshape(-1, *[1] * (x.ndim - 1))


def gaussian_log_prob(action: jax.Array, mean: jax.Array, log_std: jax.Array) -> jax.Array:
    """Log-density [...] of `action` [..., 4] under independent Gaussians, summed over dimensions."""
    deviation = (action - mean) * jnp.exp(-log_std)
    return jnp.sum(-0.5 * deviation**2 - log_std - 0.5 * jnp.log(2.0 * jnp.pi), axis=-1)


def gaussian_entropy(log_std: jax.Array) -> jax.Array:
    """Entropy in nat of each dimension."""
    return log_std + 0.5 * jnp.log(2.0 * jnp.pi * jnp.e)


def project_log_std(parameters: Parameters, learn: LearnConfig) -> Parameters:
    """The parameters with their log standard deviation [4] moved back to its bounds.

    After every gradient step, and not in the loss: a clip there has no gradient beyond a bound, so
    that a parameter could never come back.
    """
    bounded = jnp.clip(parameters.log_std, learn.min_log_std, learn.max_log_std)
    return parameters.replace(log_std=bounded)
