"""``simwarp eval``: episodes, grids of settings, and what is told of them."""
