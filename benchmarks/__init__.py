"""Benchmarks: times compared side by side in one run, with a report page of their own; ``make bench`` runs them."""
