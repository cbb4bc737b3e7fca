"""Distribution of jobs to the workers of an engine: any executor of ``concurrent.futures``, such as that of a Dask client.

A job has independent parts: the cases of a sweep, the starts of a design, the runs of a study. The engine is given batches of
about a second: a bundle of the job with its tables, and the indices of some parts. Workers return checksummed lines of the
job's journal, and only this program writes files. The engine needs ``submit`` and futures that are done, cancelled or failed.
"""

from __future__ import annotations

import os
import queue
import signal
import socket
import threading
import time
import warnings
from collections import deque
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Callable, Iterator, Optional, Protocol

from . import _caudal
from ._caudal import __version__
from .arguments import check_count, is_number
from .errors import EngineError, Error, LostCasesError

#: Time that a batch should take, s: a hundred times what an engine needs to pass it on.
BATCH_S = 1.0

#: Batches that wait for each worker, so that none is idle.
WAITING = 2

#: A batch has at most this many times the parts of the largest before it.
GROWTH = 4

#: Time between looks at how many workers there are, and at whether anything came back at all, s.
LOOK_S = 2.0

#: Ways to do a part, each tried where the one before ended its worker: with others, in a task of its own beside other
#: tasks, and alone on the whole engine, where no neighbour can be to blame.
IN_BATCH, BY_ITSELF, ALONE = range(3)

Progress = Callable[[int, int], Any]


class Job(Protocol):
    """A job whose parts an engine can run."""

    @property
    def noun(self) -> str:
        """The noun for a part."""

    @property
    def worker(self) -> str:
        """The function of the core that runs parts on a worker."""

    @property
    def folder(self) -> Path:
        """The folder of the results."""

    @property
    def size(self) -> int:
        """Number of parts."""

    def todo(self) -> list[int]:
        """The indices of the remaining parts."""

    def describe(self, index: int) -> str:
        """A description of a part."""

    def bundle(self) -> bytes:
        """The bundle that a worker needs."""

    def keep(self, lines: list[bytes]) -> int:
        """Store returned lines; return how many of them are new."""

    def close(self) -> None:
        """Release the journal for other programs."""


def work(version: str, worker: str, bundle: bytes, indices: list[int], attempt: int) -> tuple[list[bytes], list[float]]:
    """Run parts of a job on a worker; return their lines and the time of each, s."""
    if version != __version__:
        raise engine_error(whereabouts(), f"it has caudal {__version__}, but the job was made by caudal {version}")
    try:
        lines: tuple[list[bytes], list[float]] = getattr(_caudal, worker)(bundle, indices)
        return lines
    except Error as error:
        raise engine_error(whereabouts(), str(error)) from error


def whereabouts() -> str:
    """The name of this worker."""
    with suppress(Exception):
        from distributed import get_worker

        return str(get_worker().address)
    return f"{socket.gethostname()}, process {os.getpid()}"


def engine_error(worker: str, reason: str) -> EngineError:
    """The error of an engine, or of one of its workers."""
    error = EngineError(f"worker {worker}: {reason}" if worker else reason)
    error.worker, error.reason = worker, reason
    return error


def lost_error(job: Job, lost: list[int]) -> LostCasesError:
    """The error for parts that terminated their workers."""
    named = "; ".join(f"{job.noun} {index}: {job.describe(index)}" for index in lost[:5])
    more = f" and {len(lost) - 5} more" if len(lost) > 5 else ""
    number = f"{len(lost)} {job.noun}{'' if len(lost) == 1 else 's'}"
    error = LostCasesError(
        f"{number} crashed the worker that ran them, even alone ({named}{more}); "
        f"the other {job.size - len(lost)} are stored in {job.folder}"
    )
    error.cases, error.rows = lost, []
    return error


@contextmanager
def interrupts() -> Iterator[Callable[[], None]]:
    """Yield a function that raises a lost interrupt: Python drops exceptions raised while objects such as futures are finalised."""
    came = False

    def note(number: int, frame: Any) -> None:
        nonlocal came
        came = True
        signal.default_int_handler(number, frame)

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    ours = main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield check
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


class Engine:
    """An executor and its number of workers."""

    @classmethod
    def asked(cls, client: Any, executor: Optional[Executor], workers: Optional[int], patience_s: float) -> Optional[Engine]:
        """The engine among the arguments of a call, or None."""
        if client is not None and executor is not None:
            raise TypeError("give either client or executor")
        for name, value in (("client", client), ("executor", executor)):
            if value is not None and not hasattr(value, "submit"):
                raise TypeError(f"{name}: found {value!r}; allowed: an object with a method submit")
        check_count("workers", workers)
        if not is_number(patience_s) or not patience_s > 0:
            raise ValueError(f"patience_s: found {patience_s!r}; allowed: a positive time")
        return None if client is None and executor is None else cls(client, executor, workers, patience_s)

    def __init__(self, client: Any, executor: Optional[Executor], workers: Optional[int], patience_s: float) -> None:
        self.client = client
        self.patience_s = patience_s
        # Equal tasks are not the same task: one that is repeated shall run again.
        self.executor: Any = client.get_executor(pure=False) if client is not None else executor
        if self.client is None:
            self.client = getattr(executor, "_client", None)  # of client.get_executor()
        self.given = workers
        self.looked = -LOOK_S
        self.known = 1

    def workers(self) -> int:
        """The number of batches that it runs concurrently, at least one."""
        if self.given is not None:
            return self.given
        if time.monotonic() - self.looked >= LOOK_S:
            self.looked = time.monotonic()
            if hasattr(self.client, "scheduler_info"):
                known = self.client.scheduler_info(n_workers=-1).get("workers", {})
                self.known = sum(worker["nthreads"] for worker in known.values())
            else:
                self.known = int(getattr(self.executor, "_max_workers", None) or os.cpu_count() or 1)
        return max(1, self.known)

    def state(self) -> str:
        """Its description for messages."""
        if hasattr(self.client, "scheduler_info"):
            return f"the client is {self.client.status}, the scheduler has {self.known} worker threads"
        return f"it is {self.executor!r}"


    def do(self, job: Job, progress: Optional[Progress] = None) -> None:
        """Run all parts of a job, and close it.

        Raises
        ------
        LostCasesError
            Where parts end their workers.
        """
        try:
            lost = Distribution(job, self, progress).run()
            if lost:
                raise lost_error(job, lost)
        finally:
            job.close()


class Distribution:
    """The distribution of the parts of a job."""

    def __init__(self, job: Job, engine: Engine, progress: Optional[Progress]) -> None:
        self.job, self.engine, self.progress = job, engine, progress
        self.bundle = job.bundle()
        self.todo = deque(job.todo())
        self.done = job.size - len(self.todo)
        #: Parts whose worker was lost, by what is to be tried next.
        self.again: dict[int, deque[int]] = {BY_ITSELF: deque(), ALONE: deque()}
        #: Those that ended their worker even alone.
        self.lost: list[int] = []
        self.flying: dict[Future[Any], tuple[list[int], int]] = {}
        self.landed: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        self.largest = 1
        self.times = (0, 0.0)

    def run(self) -> list[int]:
        """Run all parts; return the indices of those that terminate their workers."""
        last, patience = time.monotonic(), self.engine.patience_s
        self.tell()
        with interrupts() as check:
            try:
                while self.send():
                    check()
                    try:
                        self.take(self.landed.get(timeout=LOOK_S))
                        last, patience = time.monotonic(), max(self.engine.patience_s, 10 * BATCH_S)
                    except queue.Empty:
                        waited = time.monotonic() - last
                        if waited > patience:
                            self.warn_of(waited)
                            patience *= 2
                check()
            finally:
                for future in self.flying:
                    future.cancel()
        return sorted(self.lost)

    def warn_of(self, waited: float) -> None:
        """Warn that nothing was returned for this time, s."""
        parts = sum(len(indices) for indices, _ in self.flying.values())
        warnings.warn(
            f"no results for {waited:.0f} s: {parts} {self.job.noun}s are outstanding; {self.engine.state()}",
            RuntimeWarning,
            stacklevel=5,
        )

    def tell(self) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(self.done, self.job.size)

    def send(self) -> bool:
        """Submit as many batches as the engine can use; return False if none is running."""
        workers = self.engine.workers()
        while len(self.flying) < WAITING * workers and (batch := self.next_batch(workers)):
            indices, attempt = batch
            try:
                future = self.engine.executor.submit(work, __version__, self.job.worker, self.bundle, indices, attempt)
            except (RuntimeError, OSError) as error:  # it was shut down, or is broken
                raise self.stopped(f"the engine accepts no more work: {error}") from error
            self.flying[future] = batch
            future.add_done_callback(self.landed.put)
        return bool(self.flying)

    def next_batch(self, workers: int) -> Optional[tuple[list[int], int]]:
        """The next parts to submit, and the attempt."""
        if self.todo:
            parts, seconds = self.times
            size = int(BATCH_S * parts / seconds) if seconds > 0 else 1
            # Towards the end smaller ones, so that all workers end together.
            size = max(1, min(size, GROWTH * self.largest, len(self.todo) // (WAITING * workers)))
            self.largest = max(self.largest, size)
            return [self.todo.popleft() for _ in range(size)], IN_BATCH
        if self.again[BY_ITSELF]:
            return [self.again[BY_ITSELF].popleft()], BY_ITSELF
        if self.again[ALONE] and not self.flying:
            return [self.again[ALONE].popleft()], ALONE
        return None

    def take(self, future: Future[Any]) -> None:
        """Store the result of a batch, or handle its failure."""
        indices, attempt = self.flying.pop(future)
        try:
            lines, times = future.result()
        except CancelledError as error:
            raise self.stopped(f"the engine cancelled its work; {self.engine.state()}") from error
        except BrokenExecutor as error:
            batches = [indices, *(other for other, _ in self.flying.values())]
            parts = ", ".join(str(index) for batch in batches for index in batch[:20])
            raise self.stopped(f"the engine failed: {error} ({self.job.noun}s outstanding: {parts})") from error
        except EngineError as error:
            raise self.stopped(error.reason, error.worker) from error
        except Exception as error:
            # Dask's word for a task whose workers died, each time that it was tried.
            if type(error).__name__ != "KilledWorker":
                reason = f"the workers cannot run the job, {type(error).__name__}: {error}; install caudal {__version__} there"
                raise self.stopped(reason) from error
            if attempt == ALONE:
                self.lost.extend(indices)
            else:
                self.again[attempt + 1].extend(indices)
            return
        self.done += self.job.keep(lines)
        # The last ones count most: parts that are neighbours take like times.
        before, seconds = self.times
        self.times = (before // 2 + len(times), seconds * (before // 2) / max(before, 1) + sum(times))
        self.tell()

    def stopped(self, reason: str, worker: str = "") -> EngineError:
        """The error that terminates it."""
        kept = f"{self.done} of {self.job.size} {self.job.noun}s are stored in {self.job.folder}; the same call resumes there"
        error = engine_error(worker, f"{reason}; {kept}")
        error.reason = reason
        return error
