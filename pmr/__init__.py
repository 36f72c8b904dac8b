"""Parametric model reduction of sliding and telescopic structures.

A beam that slides through pads changes its boundary conditions all the time.  `pmr` reduces it with one global
basis whose coordinates keep their meaning, and leaves the sliders as a few constraint rows that move.
"""

__version__ = "0.1.0"
