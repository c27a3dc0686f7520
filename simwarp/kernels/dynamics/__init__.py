"""The step of one world, one stage per file."""
