"""Many runs and one table of them.

A study file (`files`) names a kind of study (`kinds`), which plans `tasks`.  `call` has `workers` compute these, in
processes of this machine or of the ranks of MPI, which write results into a store; `results` makes one table of them.
"""
