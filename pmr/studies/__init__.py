"""Many runs and one table of them.  A study file (`files`) names its kind, which plans `tasks`.

`call` has them done by `workers`, processes here or beside the ranks of MPI, which put results into a store; `results`
makes one table of them.
"""
