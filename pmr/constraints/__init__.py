"""Constraint rows C(s) as piecewise polynomials in the path coordinate s."""
