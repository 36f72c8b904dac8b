"""``python -m pmr`` is the command line."""

from pmr.cli import main

main()
