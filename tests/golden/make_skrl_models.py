"""The networks of `make_skrl_golden`, as skrl's models."""

import torch
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model

OBSERVATION_SIZE, ACTION_SIZE, HIDDEN_SIZES = 7, 3, (16, 8)


GAIN = 2.0**0.5


def mlp(output_size: int) -> torch.nn.Sequential:
    """Hidden layers with ELU and a linear output."""
    layers: list[torch.nn.Module] = []
    width = OBSERVATION_SIZE
    for size in HIDDEN_SIZES:
        layers += [torch.nn.Linear(width, size), torch.nn.ELU()]
        width = size
    return torch.nn.Sequential(*layers, torch.nn.Linear(width, output_size))


class Policy(GaussianMixin, Model):
    """Gaussian with a free log-std; the log-probability is of the unclipped action."""

    def __init__(self, observation_space, action_space, log_std):
        Model.__init__(self, observation_space, action_space, "cpu")
        GaussianMixin.__init__(
            self,
            clip_actions=False,
            clip_log_std=True,
            min_log_std=-20,
            max_log_std=2,
            reduction="sum",
        )
        self.net = mlp(ACTION_SIZE)
        self.log_std_parameter = torch.nn.Parameter(torch.tensor(log_std))

    def compute(self, inputs, role):
        return self.net(inputs["states"]), self.log_std_parameter, {}


class Value(DeterministicMixin, Model):
    """State value in the value scaler's normalised units."""

    def __init__(self, observation_space, action_space):
        Model.__init__(self, observation_space, action_space, "cpu")
        DeterministicMixin.__init__(self, clip_actions=False)
        self.net = mlp(1)

    def compute(self, inputs, role):
        return self.net(inputs["states"]), {}
