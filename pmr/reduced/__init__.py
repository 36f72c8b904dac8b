"""Reduced model of a body, in one file; it needs only NumPy and SciPy."""
