"""Kinds of studies: each module is called as the ``kind`` in a study file and has a class ``Study``."""
