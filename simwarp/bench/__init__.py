"""How fast a scene, a vehicle, a sensor or a task runs, told only where its final state is sound."""
