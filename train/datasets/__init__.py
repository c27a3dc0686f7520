"""Recorded episodes: trajectories in ``.npz`` files, and datasets that other libraries read."""
