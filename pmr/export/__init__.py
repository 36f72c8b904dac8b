"""Files that other programs read, one format a module or folder."""
