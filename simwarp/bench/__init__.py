"""Benchmarks of scenes, vehicles, sensors and tasks; a speed counts only where the final state is sound."""
