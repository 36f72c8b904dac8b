"""Figures of a run: each reads a result, computes nothing and returns a matplotlib figure."""
