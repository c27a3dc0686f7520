"""Commands that learn from what others do: ``record``, ``clone``, ``distill``."""
