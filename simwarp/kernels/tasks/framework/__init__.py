"""Device halves of the loop that all tasks share."""
