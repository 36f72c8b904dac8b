"""Structural models, one file each: weak forms, point rows and slider rows."""
