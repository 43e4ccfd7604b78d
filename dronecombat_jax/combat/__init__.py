"""The game: rules, observations, rewards, the environment, scripted pilots.

Rules, observations and rewards work on plain arrays and know no MuJoCo.
What does not live here: learning (`learn`).
"""
