"""Other learners on the same game, measured beside ours: `python -m benchmarks.peers.compare`."""
