"""Calls of cd-pre, cd-solve and cd-post."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import warnings

from ._error import CdError, CdWarning


def find_program(name: str) -> str:
    """Returns the path of a program: the one installed with this module, otherwise the first on PATH.

    Parameters
    ----------
    name : str
        ``cd-pre``, ``cd-solve`` or ``cd-post``.

    Raises
    ------
    CdError
        If it is in neither.
    """
    # An interpreter may run without its environment being activated: then its scripts are not on PATH.
    found = shutil.which(name, path=sysconfig.get_path("scripts")) or shutil.which(name)
    if found is None:
        raise CdError(f"{name}: program: is not on PATH; expected the programs of pip install, or their folder in PATH")
    return found


def run_program(name: str, *arguments: str | os.PathLike[str], accept: tuple[int, ...] = (0,)) -> str:
    """Runs a program to its end.

    Parameters
    ----------
    name : str
        ``cd-pre``, ``cd-solve`` or ``cd-post``.
    *arguments : str or path
        Arguments, as on the command line.
    accept : tuple of int
        Exit codes that are no errors.

    Returns
    -------
    str
        Standard output. The lines on standard error are given as a `CdWarning`.

    Raises
    ------
    CdError
        With the message and the exit code of the program.
    """
    command = [find_program(name), *(os.fspath(argument) for argument in arguments)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", errors="replace")
    check_exit(name, done.returncode, done.stderr, accept)
    return done.stdout


def check_exit(name: str, exit_code: int, messages: str, accept: tuple[int, ...] = (0,)) -> None:
    """Raises the error of a program that failed; gives the messages of one that did not as a warning."""
    messages = messages.strip()
    if exit_code not in accept:
        raise CdError(messages or f"{name}: ended with the exit code {exit_code}, without a message", exit_code)
    if messages:
        warnings.warn(messages, CdWarning, stacklevel=3)
