"""Device halves of the tasks: what a control step does beside the physics."""
