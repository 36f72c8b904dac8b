"""Figures of a run: each function draws what a result holds, computes no new values and returns a matplotlib figure."""
