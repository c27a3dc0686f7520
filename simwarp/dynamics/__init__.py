"""Host side of the dynamics: spanning tree and tables."""
