"""Views of the environment for other libraries.

What does not live here: the environment (`combat`).
"""
