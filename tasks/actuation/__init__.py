"""Motors of tasks: actuators that `randomise` can name, and learned ones."""
