"""Text of Python values in RON, the notation of scenes."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping

import numpy as np

from ._error import CdError

_WIDTH = 100
"""Length of a line above which the values of a list or a structure are written on lines of their own."""


class Variant:
    """Named value of a scene, such as a law, a shape or an action.

    Parameters
    ----------
    name : str
        Name in the scene. The value itself is written without brackets; a call adds brackets with values or fields.

    Examples
    --------
    >>> ron(Variant("Sphere"))
    'Sphere'
    >>> ron(Variant("Ball")())
    'Ball()'
    >>> ron(Variant("IQS_CLB")(friction=0.4))
    'IQS_CLB(friction: 0.4)'
    >>> ron(Variant("AddSpin")((0.0, 0.0, 1e-5)))
    'AddSpin((0.0, 0.0, 1e-05))'
    """

    def __init__(self, name: str) -> None:
        self.name = _identifier(name)
        self.content: tuple[object, ...] | dict[str, object] | None = None

    def __call__(self, *values: object, **fields: object) -> Variant:
        """Returns the variant with values in brackets, or with named fields."""
        if values and fields:
            raise CdError(f"{self.name}: values and named fields together; expected only one of the two")
        variant = Variant(self.name)
        variant.content = fields or values
        return variant

    def __repr__(self) -> str:
        return ron(self)


def ron(value: object) -> str:
    """Returns a value as RON, the notation of scenes and of some options.

    Parameters
    ----------
    value : object
        dict with names as keys: structure ``(name: value)``; list: ``[...]``; tuple: ``(...)``; str: text in quotes;
        bool, int, float and the scalars of NumPy: all digits are kept; None: ``None``; `Variant` or a member of an
        `enum.Enum`: its name. Arrays are rejected, since they may be lists or vectors: write ``x.tolist()`` or
        ``tuple(x)``.

    Returns
    -------
    str
        One line, or several indented ones if it is longer than 100 characters.

    Raises
    ------
    CdError
        For a value of another type, or a number that is not finite.

    Examples
    --------
    >>> ron({"name": "ROCKx", "density": 2700.0, "radii": [1, 2.5], "axis": (0, 0, 1), "driven": None})
    '(name: "ROCKx", density: 2700.0, radii: [1, 2.5], axis: (0, 0, 1), driven: None)'
    """
    return _text(value, 0)


def _text(value: object, indent: int) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool):
        return {None: "None", True: "true", False: "false"}[value]
    if isinstance(value, enum.Enum):
        return _identifier(value.name)
    if isinstance(value, (int, float)):
        if not math.isfinite(value):
            raise CdError(f"ron: {value}; expected a finite number")
        return repr(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Variant):
        if value.content is None:
            return value.name
        return value.name + _bracketed(value.content, indent)
    if isinstance(value, (Mapping, tuple, list)):
        return _bracketed(value, indent)
    hint = ": write x.tolist() for a list or tuple(x) for a vector" if isinstance(value, np.ndarray) else ""
    expected = "dict, list, tuple, str, bool, int, float, None, Variant or Enum"
    raise CdError(f"ron: a value of type {type(value).__name__}{hint}; expected {expected}")


def _bracketed(value: Mapping[str, object] | tuple[object, ...] | list[object], indent: int) -> str:
    """Returns a structure, tuple or list, on one line if there is space for it."""
    opening, closing = "[]" if isinstance(value, list) else "()"

    def items(indent: int) -> list[str]:
        if isinstance(value, Mapping):
            return [f"{_identifier(name)}: {_text(item, indent)}" for name, item in value.items()]
        return [_text(item, indent) for item in value]

    line = opening + ", ".join(items(indent)) + closing
    if indent + len(line) <= _WIDTH and "\n" not in line:
        return line
    inner = " " * (indent + 4)
    return f"{opening}\n" + "".join(f"{inner}{item},\n" for item in items(indent + 4)) + " " * indent + closing


def _identifier(name: object) -> str:
    if not isinstance(name, str) or not name.isidentifier() or not name.isascii():
        raise CdError(f"ron: {name!r}; expected a name of ASCII letters, digits and underscores")
    return name


def _quoted(text: str) -> str:
    escapes: dict[str, str] = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    escape: Callable[[str], str] = lambda c: escapes.get(c) or (c if c.isprintable() else f"\\u{{{ord(c):x}}}")
    return '"' + "".join(map(escape, text)) + '"'
