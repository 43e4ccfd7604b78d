"""Opponents from the past: the pool, the samplers, one jitted chunk of training.

IPPO is self-play with probability 0.
What does not live here: learning from a rollout (`learn`), files (`files`).
"""
