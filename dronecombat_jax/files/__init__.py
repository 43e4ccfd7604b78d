"""Files that survive a kill: atomic writes, locks, the run directory, checkpoints, metrics.

They hold arrays and plain JSON.
What does not live here: what the arrays mean to training (`runs`), policies (`policies`).
"""
