"""HTML representations of objects for notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any


def number(value: Any) -> str:
    """A value in a cell."""
    if isinstance(value, float):
        return f"{value:.6g}"
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def shown(it: Any) -> str:
    """A scene, stepper, snapshot or variable of the core: its repr, and a table of its content."""
    begin = f"<p>{html.escape(repr(it))}</p>"
    kind = type(it).__name__
    if kind == "Scene":
        return begin + table(("key", "value"), it.parameters.items())
    if kind == "Variable":
        rows = ((name, getattr(it, name)) for name in ("name", "unit", "causality", "shape", "description"))
        return begin + table(("of the variable", ""), rows)
    if kind == "Stepper" and "in use" not in repr(it):
        scalars = ((name, variable) for name, variable in it.variables.items() if variable.shape == ())
        return begin + table(("variable", "now", "unit"), ((name, it.get(name), variable.unit) for name, variable in scalars))
    return begin


def table(columns: Sequence[str], rows: Iterable[Iterable[Any]]) -> str:
    """An HTML table."""
    head = "".join(f"<th>{html.escape(column)}</th>" for column in columns)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(number(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
