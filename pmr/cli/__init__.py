"""The command line, one module a command."""

from pmr.cli.app import main

__all__ = ["main"]
