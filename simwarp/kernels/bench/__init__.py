"""What benchmarks run on the device beside the engine."""
