"""The engine of studies: tasks, their graph, workers, and the store of what is finished."""
