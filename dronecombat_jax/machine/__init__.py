"""What depends on the machine: JAX's backend, XLA's flags, OpenGL, several processes.

What does not live here: the table that `dronecombat doctor` prints (`cli`).
"""
