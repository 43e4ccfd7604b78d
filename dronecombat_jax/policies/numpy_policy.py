"""Flies a policy that `dronecombat export` wrote, with NumPy alone. Copy this one file to your
robot.

    policy = NumpyPolicy("attacker.safetensors")
    action = np.clip(policy(observation), -1.0, 1.0)  # [35] -> [4], or [N, 35] -> [N, 4]

A policy with memory (`policy.about["memory"]`) must be called at every step of a fight, from the first
on; `policy.reset()` makes it forget, before another fight begins.

`policy.about` tells what the numbers are: observation_fields, action_fields, control_dt,
environment.
"""

import json
import struct

import numpy as np


class NumpyPolicy:
    """The mean action of one policy, before the game clips it; `about` is the file's metadata, all
    text.
    """

    def __init__(self, path):
        with open(path, "rb") as file:
            (length,) = struct.unpack("<Q", file.read(8))
            header = json.loads(file.read(length)) if length <= 1_000_000 else {}
            data = file.read()
        self.about = header.pop("__metadata__", {})
        if "mates" in self.about:
            one = "dronecombat export RUN --drone 2 FILE writes that of the second alone"
            raise ValueError(
                f"{path}: it holds the policies of {self.about['mates']} drones; {one}"
            )
        known = self.about.get("format_version") in ("1", "2")
        if self.about.get("format") != "dronecombat-policy" or not known:
            raise ValueError(f"{path}: no dronecombat policy of format 1 or 2")
        arrays = {name: self._array(data, entry) for name, entry in header.items()}
        if not all(np.isfinite(array).all() for array in arrays.values()):
            raise ValueError(f"{path}: NaN or infinity inside")
        layers = len(json.loads(self.about["layer_sizes"])) - 1
        self.layers = [(arrays[f"weights.{i}"], arrays[f"biases.{i}"]) for i in range(layers)]
        self.others = [arrays[name] for name in arrays if name.startswith("others_")]
        self.mean = arrays["observation_mean"]
        self.scale = np.sqrt(arrays["observation_variance"]) + np.float32(
            self.about["normalization_epsilon"]
        )
        self.clip = np.float32(self.about["normalization_clip"])
        self.normalize = self.about["normalize_observations"] == "true"
        kind, _, number = self.about.get("memory", "none").partition(" ")
        if kind not in ("none", "frames", "gru"):
            raise ValueError(f"{path}: its memory is {kind}, which this reader does not know")
        parts = ("weights", "state_weights", "biases", "candidate_bias")
        self.gru = [arrays[f"gru_{part}"] for part in parts] if kind == "gru" else []
        self.memory_size = int(number or 0)
        if kind == "frames":
            self.memory_size = (self.memory_size - 1) * self.mean.size
        self.reset()

    def reset(self):
        """Forget: a fight is about to begin."""
        self.memory = None

    def __call__(self, observation):
        x = np.asarray(observation, np.float32)
        if x.shape[-1:] != self.mean.shape:
            raise ValueError(
                f"observation of shape {x.shape}: its last axis must be {self.mean.size} long"
            )
        if self.normalize:
            x = np.clip((x - self.mean) / self.scale, -self.clip, self.clip)
        if self.memory_size:
            x = self._remember(x)
        if self.others:
            x = self._encode(x)
        for weight, bias in self.layers[:-1]:
            x = self._elu(x @ weight + bias)
        return x @ self.layers[-1][0] + self.layers[-1][1]

    def _remember(self, x):
        """Scaled observations [..., 35] and what is remembered before them; keeps what is after."""
        if self.memory is None:
            self.memory = np.zeros((*x.shape[:-1], self.memory_size), np.float32)
        if self.gru:
            self.memory = self._gru(x, self.memory)
            return np.concatenate([x, self.memory], axis=-1)
        x = np.concatenate([x, self.memory], axis=-1)
        self.memory = x[..., : self.memory_size]
        return x

    def _gru(self, x, state):
        """The next state of a gated recurrent unit."""
        weights, state_weights, biases, candidate_bias = self.gru
        reset, update, candidate = np.split(x @ weights + biases, 3, axis=-1)
        of_state = np.split(state @ state_weights, 3, axis=-1)
        sigmoid = lambda x: 0.5 * (np.tanh(0.5 * x) + 1)
        reset, update = sigmoid(reset + of_state[0]), sigmoid(update + of_state[1])
        candidate = np.tanh(candidate + reset * (of_state[2] + candidate_bias))
        return (1 - update) * candidate + update * state

    def _encode(self, x):
        """The mean, over those who are seen, of a layer on the slots of observation `nearest`."""
        biases, weights = sorted(self.others, key=np.ndim)
        groups, inputs, _ = weights.shape
        own = self.layers[0][0].shape[0] - groups * (biases.shape[1] + 1)
        slots = x[..., own:].reshape(*x.shape[:-1], groups, -1, inputs + 1)
        seen = slots[..., -1:] > 0.5
        units = self._elu(slots[..., :-1] @ weights + biases[:, None])
        mean = np.where(seen, units, 0).sum(-2) / np.maximum(seen.sum(-2), 1)
        others = np.concatenate([mean, seen.any(-2)], axis=-1, dtype=np.float32)
        return np.concatenate([x[..., :own], others.reshape(*x.shape[:-1], -1)], axis=-1)

    @staticmethod
    def _elu(x):
        return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))

    @staticmethod
    def _array(data, entry):
        (begin, end), shape = entry["data_offsets"], entry["shape"]
        return np.frombuffer(data[begin:end], "<f4").reshape(shape)
