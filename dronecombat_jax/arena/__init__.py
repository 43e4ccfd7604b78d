"""Fights between policies, many at once: matches, lanes, the round robin.

What does not live here: who takes part (`tournaments`), what the outcomes say (`analysis`).
"""
