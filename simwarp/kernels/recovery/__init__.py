"""Recovery from states that no motion leads to."""
