"""Dictionaries whose errors for unknown names list the known ones."""

from __future__ import annotations

import difflib
from typing import Any, Iterable, NoReturn

from .errors import UnknownVariableError


def unknown(name: object, there: Iterable[str], found: str = "is not there", remedy: str = "") -> UnknownVariableError:
    """The error for an unknown `name`, with the most similar ones of those that are `there`."""
    there = list(there)
    lower = {other.lower(): other for other in there}
    near = [lower[other] for other in difflib.get_close_matches(str(name).lower(), lower, n=3)]
    advice = "did you mean " + " or ".join(f"`{other}`" for other in near) + "?" if near else "allowed: " + ", ".join(there)
    error = UnknownVariableError(f"`{name}` {found}; {advice}{remedy}")
    error.name, error.nearest = str(name), near[0] if near else None
    return error


class Fields(dict[str, Any]):
    """Values by name. A name that is not among them is an `UnknownVariableError`, a KeyError that names those that are."""

    def __missing__(self, name: object) -> NoReturn:
        raise unknown(name, self)
