"""Residual flexibility of a full model: what a basis leaves out, by static solves, as tables in s."""
