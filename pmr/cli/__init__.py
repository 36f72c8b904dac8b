"""The command line of pmr, with one module for each group of commands."""

from pmr.cli.app import main

__all__ = ["main"]
