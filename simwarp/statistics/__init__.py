"""Statistics that training, studies and benchmarks share."""
