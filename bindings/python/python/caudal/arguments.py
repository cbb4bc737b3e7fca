"""Checks of arguments of functions: an error names the argument, what was found and what is allowed."""

from __future__ import annotations

import numbers
import os
from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt


def is_number(value: Any) -> bool:
    """Whether `value` is a real number, and no truth value."""
    return isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_))


def check_count(name: str, value: Optional[int]) -> None:
    """Reject what is neither None nor a whole number of at least 1."""
    if value is not None and (not is_number(value) or not isinstance(value, numbers.Integral) or value < 1):
        raise ValueError(f"{name}: found {value!r}; allowed: a whole number, 1 or more")


def check_folder(name: str, path: Union[str, os.PathLike[str], None]) -> None:
    """Refuse an empty path, which would be the working directory."""
    if path is not None and not os.fspath(path):
        raise ValueError(f"{name}: found ''; allowed: the path of a folder, \".\" for the working directory")


def check_function(name: str, function: Any, required: bool = False) -> None:
    """Reject what is not a function; None is allowed unless it is required."""
    if not callable(function) and (required or function is not None):
        raise TypeError(f"{name}: found {function!r}; allowed: a function")


def names_of(names: Union[str, Iterable[str]], argument: str) -> list[str]:
    """Names as a list; a string is a single name."""
    if isinstance(names, str):
        return [names]
    found = list(names) if isinstance(names, Iterable) else [names]
    if not isinstance(names, Iterable) or not all(isinstance(name, str) for name in found):
        raise TypeError(f"{argument}: found {names!r}; allowed: a name, or a list of names")
    return found


def mapping_of(values: Optional[Mapping[str, Any]], argument: str) -> dict[str, Any]:
    """A copy of the dictionary; empty for None."""
    if values is not None and not isinstance(values, Mapping):
        raise TypeError(f"{argument}: found {values!r}; allowed: a dict by name")
    return dict(values or {})


def numbers_of(value: Any, argument: str) -> npt.NDArray[np.float64]:
    """`value` as an array of doubles. What are no real numbers, as texts, None and complex numbers, is a TypeError."""
    allowed = "allowed: a number, or an array of numbers"
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{argument}: found lists of different lengths; {allowed}") from error
    if array.dtype.kind not in "fiub":
        found = f"an array of the shape {array.shape} and the type {array.dtype}" if array.ndim else repr(value)
        raise TypeError(f"{argument}: found {found}; {allowed}")
    return np.require(array, np.float64, ["C", "A"])


def arrays_of(values: Optional[Mapping[str, npt.ArrayLike]], argument: str = "values") -> list[tuple[str, Any]]:
    """Copies of the values as arrays."""
    return [(name, numbers_of(value, name).copy()) for name, value in mapping_of(values, argument).items()]
