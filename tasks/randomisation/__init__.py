"""Randomisation of worlds per episode, sensing noise and delay, curricula, and their random numbers."""
