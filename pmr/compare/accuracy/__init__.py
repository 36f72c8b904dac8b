"""Search for the smallest model and the longest step within a tolerance, with the error of each part.

The search works on one reduced model with enrichment modes, which contains every smaller model
(`pmr.system.truncation`).
"""
