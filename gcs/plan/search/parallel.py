"""Several flights optimised at once, in processes of their own, where that is quicker than one after the other.

Knows: processes, and what it costs to start them. Does not know: what is optimised, what becomes of the results.
Results are those of one process, in the same order: nothing is decided here. Workers end with the call, however it
ends.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
from collections.abc import Callable, Sequence
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

START_S = 2.5  # until a worker has loaded the optimiser


def pays(tasks: int, workers: int, expected_s: float) -> bool:
    """Whether workers are quicker than one process, for so many tasks of so many seconds each."""
    return workers > 1 and tasks > 0 and expected_s * (tasks - math.ceil(tasks / min(workers, tasks))) > START_S


def each(work: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> list[Result]:
    """Results of `work` in the order of the tasks; the first failure in that order ends all and is raised here."""
    pool = multiprocessing.get_context("spawn").Pool(min(workers, len(tasks)), _leave_ctrl_c_to_the_parent)
    try:
        return list(pool.imap(work, tasks))
    finally:
        pool.terminate()
        pool.join()


def _leave_ctrl_c_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
