"""Exceptions. Each has its values as attributes; its message tells the place and the remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Optional

if TYPE_CHECKING:
    from .result import Result


class Error(Exception):
    """Base class of all errors of caudal.

    Attributes
    ----------
    result : Result or None
        What was computed until then, where it ended a run.
    """

    result: Optional[Result] = None


class SceneError(Error, ValueError):
    """A scene, or an override of one of its keys, is not valid.

    Attributes
    ----------
    place : str
        File and line, or the override.
    key : str
        Dotted key, for example ``rod.nodes``; empty where no single key is to blame.
    problem : str
        What was found and what is allowed.
    """

    place: str
    key: str
    problem: str


class ReadError(Error, OSError):
    """A file cannot be read.

    Attributes
    ----------
    path : str
        The file.
    reason : str
        The operating system's reason.
    """

    path: str
    reason: str


class WriteError(Error, OSError):
    """A file or folder cannot be written.

    Attributes
    ----------
    path : str
        The file or folder.
    reason : str
        The operating system's reason.
    """

    path: str
    reason: str


class SeveralError(Error, ValueError):
    """A scene has several errors; the message has a line for each.

    Attributes
    ----------
    value : list of dict
        The mistakes.
    """

    value: list[dict[str, object]]


class BusyError(Error, OSError):
    """Another program is working in a folder of results.

    Attributes
    ----------
    path : str
        The folder.
    """

    path: str


class OccupiedError(Error, OSError):
    """A folder holds other results than those that would be written.

    Attributes
    ----------
    path : str
        The folder.
    holds : str
        What is there.
    wanted : str
        What would be written.
    """

    path: str
    holds: str
    wanted: str


class RoomError(Error, OSError):
    """There is not enough space on the disk.

    Attributes
    ----------
    path : str
        The folder.
    what : str
        What would be written, and the keys that say so.
    needed : float
        Its size, bytes.
    free : float
        Room on the disk, bytes.
    """

    path: str
    what: str
    needed: float
    free: float


class ThreadsError(Error, OSError):
    """The system provides fewer threads than requested.

    Attributes
    ----------
    wanted : int
        How many were asked for.
    started : int
        How many there were.
    reason : str
        The operating system's reason.
    """

    wanted: int
    started: int
    reason: str


class JournalError(Error):
    """A journal of results cannot be used.

    Attributes
    ----------
    path : str
        The file.
    problem : str
        What is wrong with it and what to do.
    """

    path: str
    problem: str


class BundleError(Error):
    """A bundle of work from another machine cannot be run.

    Attributes
    ----------
    problem : str
        What is wrong with it.
    """

    problem: str


class EngineError(Error, RuntimeError):
    """The engine that runs a distributed job failed. Finished parts are stored, and the same call resumes, with this engine,
    another one or none.

    Attributes
    ----------
    worker : str
        The worker that caused it; empty if it was not a single one.
    reason : str
        Its message.
    """

    worker: str = ""
    reason: str = ""


class LostCasesError(Error, RuntimeError):
    """Cases of a sweep, starts of a design or runs of a study crashed their worker, again when each ran alone. All others are
    stored; the table and report of a sweep contain these.

    Attributes
    ----------
    cases : list of int
        Their numbers.
    rows : list of dict
        For a sweep, the rows of the others, as ``caudal.sweep`` returns them.
    """

    cases: list[int]
    rows: list[dict[str, object]]


class NotConvergedError(Error, ArithmeticError):
    """Newton's method did not converge, even after the step was halved.

    Attributes
    ----------
    time_s, step_s : float
        Time the step aimed at, and the (halved) step.
    iterations : int
        Newton iterations made.
    increment_m, residual_n : float
        Largest displacement increment of the last iteration, and largest residual force.
    node : int
        Node with the largest residual.
    """

    time_s: float
    step_s: float
    iterations: int
    increment_m: float
    residual_n: float
    node: int


class NotFiniteError(Error, ArithmeticError):
    """A number is not finite.

    Attributes
    ----------
    time_s : float
        Time.
    node : int
        Node.
    what : str
        Which quantity.
    """

    time_s: float
    node: int
    what: str


class FoldOverError(Error, ArithmeticError):
    """The rod folded over at a joint, where its curvature is singular.

    Attributes
    ----------
    time_s : float
        Time.
    node : int
        The joint's node.
    """

    time_s: float
    node: int


class EdgeCollapseError(Error, ArithmeticError):
    """An edge collapsed, or turned over within one step.

    Attributes
    ----------
    time_s : float
        Time.
    node : int
        First node of the edge.
    length_m : float
        Its length.
    """

    time_s: float
    node: int
    length_m: float


class ToleranceError(Error, ArithmeticError):
    """The estimated error of a step stays above the tolerance, however small the step.

    Attributes
    ----------
    time_s, step_s : float
        Time, and the last step.
    tolerance : float
        The tolerance.
    """

    time_s: float
    step_s: float
    tolerance: float


class LinearError(Error, ArithmeticError):
    """A linear solver could not be set up.

    Attributes
    ----------
    unknowns : int
        Size of the system.
    reason : str
        The solver's reason.
    """

    unknowns: int
    reason: str


class InterruptedError(Error, RuntimeError):
    """Another thread interrupted the computation."""


class StepError(Error, ValueError):
    """The communication step is not a positive, finite time.

    Attributes
    ----------
    value : float
        The step, s.
    """

    value: float


class UnknownVariableError(Error, KeyError):
    """No variable has this name in this scene, or none is recorded under it.

    Attributes
    ----------
    name : str
        The name asked for.
    nearest : str or None
        The most similar name there is.
    """

    name: str
    nearest: Optional[str]

    __str__ = Exception.__str__  # a KeyError would show its text in quotes


class NotAnInputError(Error, ValueError):
    """Only inputs can be set.

    Attributes
    ----------
    value : str
        Name of the variable.
    """

    value: str


class WrongLengthError(Error, ValueError):
    """An array of the wrong length was given for a variable.

    Attributes
    ----------
    name : str
        The variable.
    expected, found : int
        Its number of values, and the number given.
    """

    name: str
    expected: int
    found: int


class BadValueError(Error, ValueError):
    """A value is outside the range of the variable.

    Attributes
    ----------
    name : str
        The variable.
    value : float
        The value given.
    allowed : str
        What is allowed.
    """

    name: str
    value: float
    allowed: str


class OrderError(Error, ValueError):
    """No derivative of this order can be set.

    Attributes
    ----------
    order, highest : int
        The order asked for, and the highest there is.
    """

    order: int
    highest: int


class SnapshotError(Error, ValueError):
    """A saved state cannot be restored.

    Attributes
    ----------
    value : str
        Why.
    """

    value: str


class StudyError(Error, ValueError):
    """The options of a study are not valid.

    Attributes
    ----------
    problem : str
        What was found and what is allowed.
    """

    problem: str


class ComparisonError(Error, ValueError):
    """Runs cannot be compared.

    Attributes
    ----------
    problem : str
        What was found and what is allowed.
    """

    problem: str


class DerivativeError(Error, ValueError):
    """A simulation does not have the requested derivative.

    Attributes
    ----------
    problem : str
        What was asked for, and what is allowed.
    """

    problem: str


class DesignError(Error):
    """No design satisfies the requirements.

    Attributes
    ----------
    reason : str
        Why not, and what excludes what.
    """

    reason: str


class FmuError(Error):
    """An FMU cannot be created.

    Attributes
    ----------
    value : str
        Why.
    """

    value: str
