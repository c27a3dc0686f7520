"""Walking robots."""
