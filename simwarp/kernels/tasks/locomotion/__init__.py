"""Device halves of the walking robots."""
