"""Kinds of studies: one module each, named as the ``kind`` in the study file, with a class ``Study``."""
