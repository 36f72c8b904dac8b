"""Studies: many runs described by one file, spread over processes or MPI ranks, and resumed where they were cut off.

`files` reads a study and plans its tasks (`task`), `graph` finds what is still to be done, `runner` has it done by one
of the `pools`, whose `worker` processes put results into the `store`; `results` makes one table of them.
"""
