"""Command `pmr` whose studies stand still once COUNT results are stored: python held.py COUNT ARGUMENTS...

So a kill or an interruption that follows comes in the middle of a study, however slow the machine is.
"""

import sys
import time

from pmr.cli import main
from pmr.studies.tasks import Failure
from pmr.studies.workers import Order, Worker

plain, done = Worker.run, list[Failure | None]()


def run(worker: Worker, order: Order) -> Failure | None:
    """Run the first `count` orders; block at any later one until the worker is closed."""
    if len(done) < count:
        done.append(plain(worker, order))
        return done[-1]
    while worker._child is not None and worker._child.poll() is None:
        time.sleep(0.01)
    return Failure("closed")


if __name__ == "__main__":
    count = int(sys.argv.pop(1))
    Worker.run = run
    main()
