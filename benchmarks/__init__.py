"""How fast everything is on this machine: measured, never tested. `docs/performance.md` says how
and what came out.
"""
