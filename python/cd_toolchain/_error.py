"""Errors and warnings of the module."""

from __future__ import annotations

import os


class CdError(Exception):
    """Error of a program, a file or a value; the text names it and says what is expected.

    Attributes
    ----------
    exit_code : int or None
        Exit code of the program that failed, negative for the number of a signal that ended it; None for errors of the
        module itself. 2: input was rejected, nothing was computed; 3: internal error; 4: ended before the last step.
    """

    def __init__(self, message: str, exit_code: int | None = None) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class CdWarning(UserWarning):
    """Messages that a program printed on its standard error although it did its work."""


def file_error(path: str | os.PathLike[str], error: OSError) -> CdError:
    """Returns the error of a file that cannot be read or written."""
    reason = "there is no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)
    return CdError(f"{os.fspath(path)}: file: {reason}; expected a file that can be read and written")
