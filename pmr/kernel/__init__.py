"""Compiled time steps of reduced bodies and their contacts (docs/kernel.md)."""
