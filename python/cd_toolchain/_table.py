"""Tables of the programs: comma-separated values with the names of the columns in the first line."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._error import CdError, file_error

Table: TypeAlias = dict[str, NDArray[Any]]
"""Columns of a table by name, all of the same length."""

_EMPTY_FIELD = re.compile(r"(?<![^,])(?![^,])")


def read_table(path: str | os.PathLike[str]) -> Table:
    """Reads a table: steps.csv, series.csv, TIMER.csv, ERRORS.csv or another CSV file of the programs.

    Parameters
    ----------
    path : path
        File. An incomplete last row, as in the table of a run in progress, is left out.

    Returns
    -------
    dict of str to array, shape (rows,)
        int64 for columns of integers, float64 for other numbers and for columns with empty fields, which become NaN,
        and text for other columns. All digits are kept.

    Raises
    ------
    CdError
        If the file cannot be read, or a row has another number of fields than the first line.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
    except OSError as error:
        raise file_error(path, error) from error
    except UnicodeDecodeError as error:
        raise CdError(f"{path}: table: is not text; expected a CSV file of the programs") from error
    lines.pop()  # empty, or a row that is being written
    if not lines:
        raise CdError(f"{path}: table: is empty; expected the names of the columns in the first line")
    names = lines.pop(0).split(",")
    return _numbers(names, lines) or _columns(path, names, lines)


def _numbers(names: list[str], lines: list[str]) -> Table | None:
    """Returns the columns of a table of numbers, each of the type of its first row; None for other tables."""
    first = lines[0].split(",") if lines else []
    types = [np.int64 if field.lstrip("-").isdigit() else np.float64 for field in first]
    filled = (_EMPTY_FIELD.sub("nan", line) for line in lines)
    if len(first) != len(names):
        return None
    try:
        rows = np.loadtxt(filled, dtype=list(zip(names, types)), delimiter=",", comments=None, ndmin=1)
    except ValueError:
        return None
    return {name: np.ascontiguousarray(rows[name]) for name in names}


def _columns(path: Path, names: list[str], lines: list[str]) -> Table:
    """Returns the columns of any table, each of the type that suits all of its fields."""
    rows = [line.split(",") for line in lines]
    for number, row in enumerate(rows, 2):
        if len(row) != len(names):
            raise CdError(f"{path}:{number}: row: {len(row)} fields; expected {len(names)}, as in the first line")
    columns = zip(*rows) if rows else ((),) * len(names)
    return {name: _column(fields) for name, fields in zip(names, columns)}


def _column(fields: tuple[str, ...]) -> NDArray[Any]:
    if not fields:
        return np.empty(0)
    try:
        return np.array([int(field) for field in fields], dtype=np.int64)
    except ValueError:
        pass
    try:
        return np.array([float(field or "nan") for field in fields])
    except ValueError:
        return np.array(fields)
