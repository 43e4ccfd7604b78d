"""One policy as an ONNX graph: observation [N, 35] -> mean action [N, 4], built node by node.

Needs the `onnx` package, an extra of this one: it is imported when a file is written, never before.
"""

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.learn.normalize import CLIP, EPSILON
from dronecombat_jax.policies.file import refuse_more_than_layers, refuse_overwriting
from dronecombat_jax.policies.info import PolicyInfo, metadata_of
from dronecombat_jax.types import ACTION_SIZE, Policy

# Old enough for the runtimes that robots carry; every operator below has kept its meaning since.
OPSET = 13
IR_VERSION = 7


def save_onnx(path: Path, policy: Policy, info: PolicyInfo, *, force: bool = False) -> None:
    """Write the graph of one policy, with the metadata of `policy.metadata_of`; `log_std` is not
    in it.

    Raises UserError: 73 where `path` exists (without `force`) or the disk refuses, 2 where onnx is
    missing, and for a policy with memory or an encoder of others.
    """
    onnx = require_onnx()
    refuse_more_than_layers(path, info)
    refuse_overwriting(path, force)
    write_atomic(path, model_of(onnx, policy, info).SerializeToString(deterministic=True))


def require_onnx() -> Any:
    """The package, or UserError 2 that tells how to get it."""
    try:
        return importlib.import_module("onnx")
    except ImportError as error:
        reason = (
            "it is not installed"
            if isinstance(error, ModuleNotFoundError)
            else " ".join(str(error).split())[:80]
        )
        message = f"an .onnx file needs the onnx package: {reason}. Fix: pip install 'dronecombat-jax[onnx]'"
        raise UserError(message, EXIT_CONFIG) from None


def model_of(onnx: Any, policy: Policy, info: PolicyInfo) -> Any:
    """The checked `ModelProto`."""
    network, scaler = policy.network, policy.observation_scaler
    nodes, constants, x = [], {}, "observation"

    def apply(operator: str, inputs: dict[str, Any], output: str, **attributes: Any) -> str:
        """Add a node on `x` and constants, given by name; returns its output's name."""
        constants.update(inputs)
        nodes.append(
            onnx.helper.make_node(operator, [x, *inputs], [output], name=output, **attributes)
        )
        return output

    if info.normalize_observations:
        x = apply("Sub", {"observation_mean": scaler.mean}, "centred")
        x = apply(
            "Div", {"observation_scale": np.sqrt(scaler.variance) + np.float32(EPSILON)}, "scaled"
        )
        x = apply("Clip", {"low": -CLIP, "high": CLIP}, "clipped")
    last = len(network.weights) - 1
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        x = apply(
            "Gemm",
            {f"weights.{i}": weight, f"biases.{i}": bias},
            "action" if i == last else f"hidden.{i}",
        )
        if i < last:
            x = apply("Elu", {}, f"elu.{i}", alpha=1.0)
    value = lambda name, size: onnx.helper.make_tensor_value_info(
        name, onnx.TensorProto.FLOAT, ["N", size]
    )
    graph = onnx.helper.make_graph(
        nodes,
        info.role,
        [value("observation", info.layer_sizes[0])],
        [value("action", ACTION_SIZE)],
        [
            onnx.numpy_helper.from_array(np.asarray(array, np.float32), name)
            for name, array in constants.items()
        ],
    )
    opsets = [onnx.helper.make_opsetid("", OPSET)]
    model = onnx.helper.make_model(
        graph, opset_imports=opsets, ir_version=IR_VERSION, producer_name="dronecombat-jax"
    )
    onnx.helper.set_model_props(model, metadata_of(info))
    onnx.checker.check_model(model, full_check=True)
    return model
