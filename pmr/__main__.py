"""``python -m pmr`` is the command line."""

from pmr.cli import main

if __name__ == "__main__":
    main()
