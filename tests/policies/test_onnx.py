"""The ONNX graph flies as the policy does, by another implementation: onnxruntime."""

import json
import sys

import jax
import numpy as np
import pytest
from policies import assert_same_actions, make_info, make_policy, observations

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, UserError
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.policies.info import metadata_of
from dronecombat_jax.policies.onnx import save_onnx

MISSING = "{} is not installed: pip install onnx onnxruntime"
SIZES = (35, 64, 32, 4)


@pytest.mark.parametrize("normalize", [True, False])
def test_onnxruntime_gives_the_same_actions(tmp_path, normalize):
    pytest.importorskip("onnx", reason=MISSING.format("onnx"))
    runtime = pytest.importorskip("onnxruntime", reason=MISSING.format("onnxruntime"))
    policy, info = (
        make_policy(SIZES),
        make_info(layer_sizes=SIZES, normalize_observations=normalize),
    )
    save_onnx(tmp_path / "a.onnx", policy, info)
    session = runtime.InferenceSession(tmp_path / "a.onnx", providers=["CPUExecutionProvider"])
    (given,), (result,) = session.get_inputs(), session.get_outputs()
    assert (given.name, given.shape, result.name, result.shape) == (
        "observation",
        ["N", 35],
        "action",
        ["N", 4],
    )
    ours = jax.jit(
        lambda seen: policy_mean(LearnConfig(normalize_observations=normalize), policy, seen)
    )
    for spread in (1.0, 4.0, *((1e4, 1e30) if normalize else ())):
        seen = observations(policy, spread, normalize)
        assert_same_actions(session.run(None, {"observation": seen})[0], np.asarray(ours(seen)))
    assert session.run(None, {"observation": observations(policy, 1.0)[:1]})[0].shape == (1, 4)

    about = session.get_modelmeta().custom_metadata_map
    assert about == metadata_of(info) and json.loads(about["layer_sizes"]) == list(SIZES)
    first = (tmp_path / "a.onnx").read_bytes()
    save_onnx(tmp_path / "a.onnx", policy, info, force=True)
    assert (tmp_path / "a.onnx").read_bytes() == first


def test_the_graph_is_made_of_few_and_old_operators(tmp_path):
    onnx = pytest.importorskip("onnx", reason=MISSING.format("onnx"))
    save_onnx(tmp_path / "a.onnx", make_policy(SIZES), make_info(layer_sizes=SIZES))
    model = onnx.load(tmp_path / "a.onnx")
    assert [node.op_type for node in model.graph.node] == [
        "Sub",
        "Div",
        "Clip",
        "Gemm",
        "Elu",
        "Gemm",
        "Elu",
        "Gemm",
    ]
    assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", 13)]
    with pytest.raises(UserError, match="is there already") as error:
        save_onnx(tmp_path / "a.onnx", make_policy(SIZES), make_info(layer_sizes=SIZES))
    assert error.value.exit_code == EXIT_CANNOT_WRITE


def test_where_onnx_is_missing_one_line_says_so(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(UserError) as error:
        save_onnx(tmp_path / "a.onnx", make_policy(SIZES), make_info(layer_sizes=SIZES))
    assert error.value.exit_code == EXIT_CONFIG and len(error.value.message.splitlines()) == 1
    assert "pip install 'dronecombat-jax[onnx]'" in error.value.message
    assert not (tmp_path / "a.onnx").exists()
