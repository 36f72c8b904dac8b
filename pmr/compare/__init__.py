"""Comparison of simulations with each other, and estimates of the error of a reduced model."""
