"""Accuracy on order: the smallest model and the longest step that hold a tolerance, and the error of each part.

It works on one reduced model with enrichment modes, which contains every smaller one (`pmr.system.truncation`).
"""
