"""What each kind of study says, one module each, named as the kind, with a function ``content``.

A kind without a module is reported by its table.
"""
