"""Ratings and statistics on plain arrays; each works on any table of wins and losses.

What does not live here: the simulator, files, pictures.
"""
