"""Sweeps: many trainings that are started, watched, resumed and compared together."""
