"""Accuracy on order: from a tolerance to the smallest model and the longest step that hold it, and what errs how much.

Works on one reduced model with enrichment modes, which holds every smaller one (`pmr.reduced.truncation`).
"""
