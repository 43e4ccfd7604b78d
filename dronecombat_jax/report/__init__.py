"""Figures, pictures, videos and replays made from what a run left behind."""
