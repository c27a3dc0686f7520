"""Panels of a page, and what they are made of."""
