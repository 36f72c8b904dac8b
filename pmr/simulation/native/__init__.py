"""The compiled simulator (``march``): generalized-alpha in modal coordinates."""
