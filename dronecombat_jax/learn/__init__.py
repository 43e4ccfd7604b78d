"""Proximal policy optimisation: networks, scalers, the rollout, one training iteration.

What does not live here: opponents (`selfplay`), files, the loop over chunks (`runs`).
"""
