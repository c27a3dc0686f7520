"""Shapes and the contacts between them."""
