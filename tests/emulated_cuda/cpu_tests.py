"""Tests that models on the emulated device are not forced upon, each with its reason."""

from __future__ import annotations

CPU_TESTS: dict[str, str] = {}
"""Beginnings of names of tests, and why."""
