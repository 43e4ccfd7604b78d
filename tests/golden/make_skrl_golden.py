"""Make `skrl_update.npz`: one update of skrl 1.4.3's torch IPPO, for the parity test to read.

What lives here: a synthetic rollout, skrl's own agent driven through its public calls, and the
arrays another implementation needs to repeat the update. What does not: any maths of skrl, any
import of this project. Runs in its own environment, never in the tests; see README.md here.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import gymnasium
import numpy as np
import skrl
import torch
from make_skrl_models import ACTION_SIZE, GAIN, OBSERVATION_SIZE, Policy, Value
from skrl.memories.torch import RandomMemory
from skrl.multi_agents.torch.ippo import IPPO
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.resources.schedulers.torch import KLAdaptiveLR

AGENTS = ("defender", "attacker")
ROLLOUT_STEPS, NUM_ENVS = 12, 8
HYPER = {
    "rollouts": ROLLOUT_STEPS,
    "learning_epochs": 3,
    "mini_batches": 4,
    "discount_factor": 0.99,
    "lambda": 0.95,
    "learning_rate": 3e-4,
    "grad_norm_clip": 1.0,
    "ratio_clip": 0.2,
    "value_clip": 0.2,
    "clip_predicted_values": True,
    "entropy_loss_scale": 0.001,
    "value_loss_scale": 1.0,
    "kl_threshold": 0.0,  # skrl's early stop, off; the schedule's threshold is KL_TARGET
    "time_limit_bootstrap": False,
}
KL_TARGET = 0.008
# Memory tensors: our name -> skrl's name, as the rollout left them and as the update left them.
RECORDED = {
    "observation": "states",
    "action": "actions",
    "log_prob": "log_prob",
    "value": "values",
    "reward": "rewards",
    "terminated": "terminated",
    "truncated": "truncated",
}
TARGETS = {"value_normalized": "values", "return_normalized": "returns", "advantage": "advantages"}
Arrays = dict[str, np.ndarray]
Tensors = dict[str, torch.Tensor]


class Variant(NamedTuple):
    """A rollout to learn from; `log_std` and `warm_batches` decide which way the rate moves."""

    seed: int
    log_std: tuple[float, ...]  # wide: small KL, the rate rises; narrow: large KL, it falls
    warm_batches: int  # updates the value scaler has seen; 0 is the first update of a run


VARIANTS = {
    # Seeds chosen so that each clip (ratio, value, gradient norm) acts in some places and not in
    # others, and no sample is within 4e-4 of an edge, where float order would decide (README.md).
    "up": Variant(seed=11, log_std=(0.0, 0.0, 0.0), warm_batches=0),
    "down": Variant(seed=49, log_std=(-1.6, -1.8, -1.4), warm_batches=1),
}


def make_agent(variant: Variant) -> IPPO:
    """skrl's agent with orthogonal weights, empty memories and new optimisers."""
    spaces = (
        gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,)),
        gymnasium.spaces.Box(-1, 1, (ACTION_SIZE,)),
    )
    models = {
        uid: {"policy": Policy(*spaces, variant.log_std), "value": Value(*spaces)} for uid in AGENTS
    }
    for pair in models.values():
        for model in pair.values():
            model.init_weights("orthogonal_", gain=GAIN)
            model.init_biases("constant_", val=0.0)
    agent = IPPO(
        possible_agents=AGENTS,
        models=models,
        memories={uid: RandomMemory(ROLLOUT_STEPS, NUM_ENVS, "cpu") for uid in AGENTS},
        observation_spaces=dict.fromkeys(AGENTS, spaces[0]),
        action_spaces=dict.fromkeys(AGENTS, spaces[1]),
        device="cpu",
        cfg=HYPER
        | {
            "learning_rate_scheduler": KLAdaptiveLR,
            "learning_rate_scheduler_kwargs": {"kl_threshold": KL_TARGET},
            "value_preprocessor": RunningStandardScaler,
            "value_preprocessor_kwargs": {"size": 1, "device": "cpu"},
            "experiment": {"write_interval": 0, "checkpoint_interval": 0},
        },
    )
    agent.init()
    return agent


def step_game(
    observation: Tensors, action: Tensors, t: int
) -> tuple[Tensors, Tensors, torch.Tensor, torch.Tensor]:
    """Next observation, reward, terminated and truncated of a made-up game.

    Both agents end together. Dense rewards below 1 a step, +-300 at `terminated` (zero sum),
    -10 now and then on top; a fresh observation after every end. The last step has ends of
    both kinds and some with both flags.
    """
    terminated = torch.rand(NUM_ENVS, 1) < 0.09
    truncated = ~terminated & (torch.rand(NUM_ENVS, 1) < 0.07)
    if t == ROLLOUT_STEPS - 1:
        terminated[:2], truncated[1:3] = True, True
    outcome = torch.where(torch.rand(NUM_ENVS, 1) < 0.5, 300.0, -300.0) * terminated
    next_observation, reward = {}, {}
    padding = (0, OBSERVATION_SIZE - ACTION_SIZE)
    for uid, sign in zip(AGENTS, (1.0, -1.0), strict=True):
        push = torch.nn.functional.pad(action[uid].clamp(-1, 1), padding)
        moved = 0.9 * observation[uid] + 0.3 * push + 0.1 * torch.randn(NUM_ENVS, OBSERVATION_SIZE)
        fresh = torch.randn(NUM_ENVS, OBSERVATION_SIZE)
        next_observation[uid] = torch.where(terminated | truncated, fresh, moved)
        dense = 1.0 - torch.tanh(observation[uid][:, :3].norm(dim=1, keepdim=True) / 5.0)
        effort = 0.05 * push.square().sum(1, keepdim=True)
        crash = 10.0 * (terminated & (torch.rand(NUM_ENVS, 1) < 0.3))
        reward[uid] = dense - effort + sign * outcome - crash
    return next_observation, reward, terminated, truncated


@torch.no_grad()
def fill_memories(agent: IPPO) -> Tensors:
    """Play one rollout as skrl's trainer does; returns the observation after the last step."""
    observation = {uid: torch.randn(NUM_ENVS, OBSERVATION_SIZE) for uid in AGENTS}
    for t in range(ROLLOUT_STEPS):
        action = agent.act(observation, timestep=t, timesteps=ROLLOUT_STEPS)[0]
        following, reward, terminated, truncated = step_game(observation, action, t)
        agent.record_transition(
            states=observation,
            actions=action,
            rewards=reward,
            next_states=following,
            terminated=dict.fromkeys(AGENTS, terminated),
            truncated=dict.fromkeys(AGENTS, truncated),
            infos={},
            timestep=t,
            timesteps=ROLLOUT_STEPS,
        )
        observation = following
    return observation


def warm_value_scaler(agent: IPPO, batches: int) -> None:
    """Give the value scalers the statistics of a run in progress: `batches` earlier returns."""
    for uid, mean in zip(AGENTS, (35.0, -20.0), strict=True):
        for _ in range(batches):
            returns = mean + 90.0 * torch.randn(ROLLOUT_STEPS, NUM_ENVS, 1)
            agent._value_preprocessor[uid](returns, train=True)


def watch_schedule(scheduler: KLAdaptiveLR) -> list[tuple[float, float]]:
    """A list that receives (mean KL, learning rate after) at every step of `scheduler`."""
    seen: list[tuple[float, float]] = []
    original = scheduler.step

    def step(kl: float) -> None:
        original(kl)
        seen.append((kl, scheduler.get_last_lr()[0]))

    scheduler.step = step
    return seen


def network_arrays(policy: Policy, value: Value) -> Arrays:
    """Copies of both networks: `w` [in, out], `b` [out], and `log_std` [action]."""
    arrays = {"log_std": policy.log_std_parameter.detach().numpy().copy()}
    for name, model in (("policy", policy), ("value", value)):
        linear = [layer for layer in model.net if isinstance(layer, torch.nn.Linear)]
        for i, layer in enumerate(linear):
            arrays[f"{name}/w{i}"] = layer.weight.detach().numpy().T.copy()
            arrays[f"{name}/b{i}"] = layer.bias.detach().numpy().copy()
    return arrays


def memory_arrays(memory: RandomMemory, names: dict[str, str]) -> Arrays:
    """Copies of memory tensors under new names, [T, N] or [T, N, size]."""
    arrays = {new: memory.get_tensor_by_name(old).numpy().copy() for new, old in names.items()}
    return {new: a[..., 0] if a.shape[-1] == 1 else a for new, a in arrays.items()}


def scaler_arrays(scaler: RunningStandardScaler) -> Arrays:
    """Copies of the statistics, float64."""
    names = {"mean": "running_mean", "variance": "running_variance", "count": "current_count"}
    return {name: getattr(scaler, buffer).numpy().copy() for name, buffer in names.items()}


def prefixed(prefix: str, arrays: Arrays) -> Arrays:
    """The same arrays, their names below `prefix`."""
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def update_golden(variant: Variant) -> Arrays:
    """One update of both agents: everything before it, everything after it."""
    torch.manual_seed(variant.seed)
    agent = make_agent(variant)
    warm_value_scaler(agent, variant.warm_batches)
    last_observation = fill_memories(agent)
    golden: Arrays = {}
    for uid in AGENTS:
        networks, scaler = (agent.policies[uid], agent.values[uid]), agent._value_preprocessor[uid]
        golden |= prefixed(f"{uid}/initial", network_arrays(*networks))
        golden |= prefixed(f"{uid}/rollout", memory_arrays(agent.memories[uid], RECORDED))
        golden[f"{uid}/rollout/last_observation"] = last_observation[uid].numpy().copy()
        golden |= prefixed(f"{uid}/value_scaler_before", scaler_arrays(scaler))
    seen = {uid: watch_schedule(agent.schedulers[uid]) for uid in AGENTS}
    agent.set_mode("train")
    agent._update(ROLLOUT_STEPS - 1, ROLLOUT_STEPS)
    for uid in AGENTS:
        networks, scaler = (agent.policies[uid], agent.values[uid]), agent._value_preprocessor[uid]
        golden |= prefixed(f"{uid}/final", network_arrays(*networks))
        golden |= prefixed(f"{uid}/update", memory_arrays(agent.memories[uid], TARGETS))
        golden |= prefixed(f"{uid}/value_scaler_after", scaler_arrays(scaler))
        schedule = dict(zip(("kl", "learning_rate"), np.array(seen[uid]).T, strict=True))
        golden |= prefixed(f"{uid}/schedule", schedule)
        for name in ("Policy", "Value", "Entropy"):
            tracked = agent.tracking_data[f"Loss / {name} loss ({uid})"]
            golden[f"{uid}/loss/{name.lower()}"] = np.array(tracked[-1])
    return golden


def scaler_golden(dtype: torch.dtype) -> Arrays:
    """A RunningStandardScaler trained on four batches of size-3 data, [B, 3] or [T, N, 3].

    Feature 1 is constant; feature 2 has an outlier beyond the clip in the last batch. `probe`
    goes through the inverse after every batch.
    """
    torch.manual_seed(5)
    scaler = RunningStandardScaler(size=3, device="cpu")
    probe = torch.linspace(-7, 7, 15, dtype=dtype)[:, None] * torch.ones(3, dtype=dtype)
    golden: Arrays = {"probe": probe.numpy()}
    spread, centre = torch.tensor([0.5, 0.0, 4.0]), torch.tensor([1.0, 2.5, -30.0])
    for k, shape in enumerate([(6, 4, 3), (10, 3), (1, 8, 3), (40, 3)]):
        batch = torch.randn(shape, dtype=dtype) * spread + centre
        if k == 3:
            batch[0, 2] = 300.0
        golden[f"{k}/input"] = batch.numpy()
        golden[f"{k}/output"] = scaler(batch, train=True).numpy()
        golden[f"{k}/inverse"] = scaler(probe, inverse=True).numpy()
        golden |= prefixed(f"{k}", scaler_arrays(scaler))
        golden[f"{k}/mean_float32"] = scaler.running_mean.float().numpy()
        golden[f"{k}/variance_float32"] = scaler.running_variance.float().numpy()
    return golden


def schedule_golden(kl: list[float], rate: list[float]) -> Arrays:
    """One step of a new KLAdaptiveLR for every pair of `kl` and `rate`."""
    rows = []
    for divergence in kl:
        for before in rate:
            optimizer = torch.optim.Adam([torch.nn.Parameter(torch.zeros(1))], lr=before)
            scheduler = KLAdaptiveLR(optimizer, kl_threshold=KL_TARGET)
            scheduler.step(divergence)
            rows.append((divergence, before, scheduler.get_last_lr()[0]))
    names = ("kl", "learning_rate_before", "learning_rate_after")
    return dict(zip(names, np.array(rows).T, strict=True))


def make_golden() -> Arrays:
    """All arrays of the file, by name."""
    golden = {f"hyper/{name}": np.array(value) for name, value in HYPER.items()}
    golden |= {"hyper/kl_target": np.array(KL_TARGET), "hyper/orthogonal_gain": np.array(GAIN)}
    golden["version/skrl"] = np.array(skrl.__version__)
    golden["version/torch"] = np.array(torch.__version__)
    for name, variant in VARIANTS.items():
        golden |= prefixed(name, update_golden(variant))
    golden |= prefixed("scaler/float32", scaler_golden(torch.float32))
    golden |= prefixed("scaler/float64", scaler_golden(torch.float64))
    kl = [0.0, 0.0039, 0.004, 0.0041, 0.008, 0.0159, 0.016, 0.0161, 0.5]
    inside, outside = [1e-6, 1.2e-6, 1e-4, 3e-4, 8e-3, 1e-2], [2e-7, 0.1]
    golden |= prefixed("kl_schedule/inside", schedule_golden(kl, inside))
    golden |= prefixed("kl_schedule/outside", schedule_golden([0.0, 0.008, 0.5], outside))
    return golden


def main() -> None:
    """Write the file on one thread, so that the bytes repeat."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("skrl_update.npz"))
    output = parser.parse_args().output
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    golden = make_golden()
    np.savez_compressed(output, **golden)
    print(f"{output}: {len(golden)} arrays, {output.stat().st_size} bytes")


if __name__ == "__main__":
    main()
