"""Evaluation of policies: episodes, grids, maps, pictures and films."""
