"""Exudyn as a simulator, and the ANCF reference in it."""

from pmr.simulate.exudyn.simulator import Formulation, add_sliding_body, simulate

__all__ = ["Formulation", "add_sliding_body", "simulate"]
