"""Tire forces: contact geometry, terrain queries, one file per model, and the kernel that applies them."""
