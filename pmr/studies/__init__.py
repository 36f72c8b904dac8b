"""Many runs and one table of them.

A study file names a kind of study (`kinds`), which plans `tasks`.  `call` reads the file and has `workers` compute the
tasks, in processes of this machine or of the ranks of MPI, which write results into a store; `study` makes one table of
the results.
"""
