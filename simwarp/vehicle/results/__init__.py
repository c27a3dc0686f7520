"""Recorded runs: what is measured, what it amounts to, and its plots."""
