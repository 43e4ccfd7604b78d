"""The run directory: checkpoints, metrics, resuming, locks and signals."""
