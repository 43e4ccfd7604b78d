"""Settings: fields, presets, TOML, flags, and the checks before a run begins.

Nothing here imports JAX: a mistake is told before anything heavy is loaded.
What does not live here: what a setting does.
"""
