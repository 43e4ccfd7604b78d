"""Fights flown to be looked at: who flies, recordings, replays, what a finished run leaves.

What does not live here: the pages and films themselves (`report`).
"""
