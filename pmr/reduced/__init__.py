"""The reduced model of a body, in one file; it needs NumPy and SciPy alone."""
