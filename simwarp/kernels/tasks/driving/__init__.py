"""Device halves of the driving tasks."""
