"""Tasks in parallel processes, where that is quicker than one after another.

Results are those of one process, in the same order. All workers end with the call, also when it raises.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
from collections.abc import Callable, Sequence
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

START_S = 2.5  # time for a worker to load the optimiser


def is_faster(tasks: int, workers: int, expected_s: float) -> bool:
    """Whether workers are faster than one process, for so many tasks of `expected_s` each."""
    return workers > 1 and tasks > 0 and expected_s * (tasks - math.ceil(tasks / min(workers, tasks))) > START_S


def run_all(work: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> list[Result]:
    """Results of `work` in the order of the tasks. The first failure in that order ends all tasks and is raised."""
    pool = multiprocessing.get_context("spawn").Pool(min(workers, len(tasks)), _leave_ctrl_c_to_the_parent)
    try:
        return list(pool.imap(work, tasks))
    finally:
        pool.terminate()
        pool.join()


def _leave_ctrl_c_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
