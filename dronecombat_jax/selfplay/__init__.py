"""Chunks of training and the pool of past opponents."""
