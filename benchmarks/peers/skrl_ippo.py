"""Peer: skrl 1.4.3's torch IPPO, two learners, on the duel in C MuJoCo (`c_mujoco`).

    python -m benchmarks.peers.skrl_ippo      # asked for its turns on stdin, see `turns`

skrl's own agent through its public calls, as its trainer makes them; the settings are those of our
`LearnConfig`.
"""

import gymnasium  # pyright: ignore[reportMissingImports]
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from skrl import logger  # pyright: ignore[reportMissingImports]
from skrl.memories.torch import RandomMemory  # pyright: ignore[reportMissingImports]
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model  # pyright: ignore[reportMissingImports]
from skrl.multi_agents.torch.ippo import IPPO  # pyright: ignore[reportMissingImports]
from skrl.resources.preprocessors.torch import RunningStandardScaler  # pyright: ignore[reportMissingImports]
from skrl.resources.schedulers.torch import KLAdaptiveLR  # pyright: ignore[reportMissingImports]

from benchmarks.peers.c_mujoco import Duel
from benchmarks.peers.turns import Turns
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.machine.backend import cores
from dronecombat_jax.types import ACTION_SIZE, OBSERVATION_SIZE, SIDES

SPACES = (
    gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,)),
    gymnasium.spaces.Box(-np.inf, np.inf, (ACTION_SIZE,)),
)


def mlp(learn: LearnConfig, output_size: int) -> torch.nn.Sequential:
    """Hidden layers with ELU and a linear output."""
    layers, width = [], OBSERVATION_SIZE
    for size in learn.hidden_sizes:
        layers += [torch.nn.Linear(width, size), torch.nn.ELU()]
        width = size
    return torch.nn.Sequential(*layers, torch.nn.Linear(width, output_size))


class Policy(GaussianMixin, Model):
    """Gaussian with a free log-std; the log-probability is of the unclipped action."""

    def __init__(self, learn: LearnConfig):
        Model.__init__(self, *SPACES, "cpu")
        bounds = {"min_log_std": learn.min_log_std, "max_log_std": learn.max_log_std}
        GaussianMixin.__init__(
            self, clip_actions=False, clip_log_std=True, reduction="sum", **bounds
        )
        self.net = mlp(learn, ACTION_SIZE)
        self.log_std_parameter = torch.nn.Parameter(
            torch.full((ACTION_SIZE,), learn.initial_log_std)
        )

    def compute(self, inputs, role):
        return self.net(inputs["states"]), self.log_std_parameter, {}


class Value(DeterministicMixin, Model):
    """State value in the value scaler's normalised units."""

    def __init__(self, learn: LearnConfig):
        Model.__init__(self, *SPACES, "cpu")
        DeterministicMixin.__init__(self, clip_actions=False)
        self.net = mlp(learn, 1)

    def compute(self, inputs, role):
        return self.net(inputs["states"]), {}


def make_agent(config: Config) -> IPPO:
    """skrl's agent with orthogonal weights and the settings of `config.learn`."""
    learn = config.learn
    models = {uid: {"policy": Policy(learn), "value": Value(learn)} for uid in SIDES}
    for model in (model for pair in models.values() for model in pair.values()):
        model.init_weights("orthogonal_", gain=learn.hidden_gain)
        model.init_biases("constant_", val=0.0)
    agent = IPPO(
        possible_agents=SIDES,
        models=models,
        memories={
            uid: RandomMemory(learn.rollout_steps, config.train.num_envs, "cpu") for uid in SIDES
        },
        observation_spaces=dict.fromkeys(SIDES, SPACES[0]),
        action_spaces=dict.fromkeys(SIDES, SPACES[1]),
        device="cpu",
        cfg={
            "rollouts": learn.rollout_steps,
            "learning_epochs": learn.epochs,
            "mini_batches": learn.minibatches,
            "discount_factor": learn.discount,
            "lambda": learn.gae_lambda,
            "learning_rate": learn.learning_rate,
            "learning_rate_scheduler": KLAdaptiveLR,
            "learning_rate_scheduler_kwargs": {"kl_threshold": learn.kl_target},
            "state_preprocessor": RunningStandardScaler,
            "state_preprocessor_kwargs": {"size": SPACES[0], "device": "cpu"},
            "value_preprocessor": RunningStandardScaler,
            "value_preprocessor_kwargs": {"size": 1, "device": "cpu"},
            "grad_norm_clip": learn.max_grad_norm,
            "ratio_clip": learn.clip_ratio,
            "value_clip": learn.clip_value,
            "clip_predicted_values": True,
            "entropy_loss_scale": learn.entropy_scale,
            "value_loss_scale": learn.value_loss_scale,
            "kl_threshold": 0.0,
            "time_limit_bootstrap": learn.bootstrap_timeout,
            "experiment": {"write_interval": 0, "checkpoint_interval": 0},
        },
    )
    agent.init()
    return agent


@torch.no_grad()
def fly(agent: IPPO, duel: Duel, observation: torch.Tensor) -> torch.Tensor:
    """One control step of all fights, recorded; returns the next observation [N, 35]."""
    actions = agent.act(dict.fromkeys(SIDES, observation), timestep=0, timesteps=1)[0]
    out = duel.step(torch.stack([actions[uid] for uid in SIDES], dim=1).numpy())
    following = torch.from_numpy(out.observation)
    column = lambda array: torch.from_numpy(array)[:, None]
    agent.record_transition(
        states=dict.fromkeys(SIDES, observation),
        actions=actions,
        rewards={uid: column(out.reward[:, i].copy()) for i, uid in enumerate(SIDES)},
        next_states=dict.fromkeys(SIDES, following),
        terminated=dict.fromkeys(SIDES, column(out.terminated)),
        truncated=dict.fromkeys(SIDES, column(out.truncated)),
        infos={},
        timestep=0,
        timesteps=1,
    )
    return following


def main() -> None:
    """Train for ever, in turns."""
    logger.setLevel("ERROR")
    config = Config()
    torch.manual_seed(0)
    agent, duel = make_agent(config), Duel(config, config.train.num_envs, threads=cores())
    observation = torch.from_numpy(duel.observe())
    turns = Turns(config.steps_per_iteration)
    while True:
        for _ in range(config.learn.rollout_steps):
            observation = fly(agent, duel, observation)
            # learns after the last step of a rollout
            agent.post_interaction(timestep=0, timesteps=1)
        turns.done()


if __name__ == "__main__":
    main()
