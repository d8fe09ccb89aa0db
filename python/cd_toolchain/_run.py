"""Runs of the programs on a scene."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
import weakref
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import TypeAlias

from ._case import Case, snapshot_paths
from ._error import CdError, file_error
from ._program import check_exit, find_program, run_program
from ._ron import ron
from ._snapshot import Snapshot

Scene: TypeAlias = str | os.PathLike[str] | Mapping[str, object]
"""Scene: its path, its text, or the dict from which `ron` writes the text."""


class Run:
    """cd-solve at work in a case; `start` returns it.

    As a context manager it stops the run at the end of the block, unless the run has ended.

    Parameters
    ----------
    case : Case
        Case with a DATBOX.
    arguments : list of str
        Arguments of cd-solve after the folder.

    Attributes
    ----------
    case : Case
        The case, whose results can be read at any time.
    """

    def __init__(self, case: Case, arguments: list[str]) -> None:
        self.case = case
        self._outbox = case.path / "OUTBOX"
        self._earlier = {path: _identity(path) for path in snapshot_paths(self._outbox).values()}
        # Files, since pipes would stop the program when they are full.
        self._printed = tempfile.mkdtemp()
        weakref.finalize(self, shutil.rmtree, self._printed, ignore_errors=True)
        self._checked = False
        command = [find_program("cd-solve"), os.fspath(case.path), *arguments]
        with open(self._file("output"), "wb") as output, open(self._file("messages"), "wb") as messages:
            # In a session of its own, Ctrl-C in the terminal does not reach it: at a second request to stop, after that
            # of `stop`, it would end without saving its last step.
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=messages, start_new_session=True
            )

    def _file(self, name: str) -> Path:
        return Path(self._printed, name)

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def is_running(self) -> bool:
        """Whether cd-solve is still at work."""
        return self._process.poll() is None

    @property
    def output(self) -> str:
        """Text that cd-solve has printed so far: lines of progress, at the end the summary."""
        return _content(self._file("output"))

    def follow(self, poll: float = 0.1) -> Iterator[Snapshot]:
        """Yields each snapshot of this run as it appears, in the order of the steps; ends when the run has ended.

        Parameters
        ----------
        poll : float
            Time between two reads of OUTBOX, s.

        Raises
        ------
        CdError
            With the message and the exit code of cd-solve, if it fails or is stopped.
        """
        last_step = -1
        while True:
            # Checked before the folder is read: what a run writes before its end is not missed.
            running = self.is_running
            for step, path in snapshot_paths(self._outbox).items():
                if step > last_step and _identity(path) not in (self._earlier.get(path), None):
                    last_step = step
                    yield Snapshot(path)
            if not running:
                break
            time.sleep(poll)
        self.wait()

    def wait(self) -> Case:
        """Waits for the end of the run.

        Returns
        -------
        Case
            The case, with all results of the run. Messages of cd-solve, such as those of steps that do not converge,
            are given once as a `CdWarning`.

        Raises
        ------
        CdError
            With the message and the exit code of cd-solve, if it fails or is stopped.
        """
        exit_code = self._process.wait()
        if exit_code != 0 or not self._checked:
            self._checked = True
            check_exit("cd-solve", exit_code, _content(self._file("messages")))
        return self.case

    def stop(self) -> Case:
        """Stops the run, if it has not ended, and waits for its end.

        cd-solve writes a snapshot of its last complete step (not on Windows), from which
        ``start(None, folder, resume=True)`` continues.

        Returns
        -------
        Case
            The case, with the results so far.
        """
        if self.is_running:
            self._process.terminate()
        self._process.wait()
        return self.case


def start(
    scene: Scene | None,
    folder: str | os.PathLike[str],
    *,
    settings: Mapping[str, object] | None = None,
    force: bool = False,
    resume: bool = False,
    **options: object,
) -> Run:
    """Prepares a case from a scene with cd-pre and starts cd-solve in it.

    Parameters
    ----------
    scene : str, path, dict or None
        Path of a scene, its text (a str with a bracket), or the dict from which `ron` writes it. None: DATBOX of the
        folder is used as it is, and cd-pre is not called. A text is written to ``folder/scene.ron``.
    folder : path
        Folder of the case; created if it is missing.
    settings : dict of str to value, optional
        Values that replace those of the scene, by their paths: ``{"grains.1.number": 2000}``.
    force : bool
        Removes the results of an earlier run. Without it a case that has results is rejected.
    resume : bool
        Continues from the last snapshot; requires the scene None.
    **options : value
        Options of cd-solve, by their names in docs/reference/options.md: ``threads=2, steps=1000, end_time=9000.0`` (s),
        ``dt=2.0`` (s), ``events=[...]``. Strings are passed as they are, other values as `ron` writes them; None leaves
        an option out.

    Returns
    -------
    Run
        The run, which continues in the background.

    Raises
    ------
    CdError
        With the message of cd-pre, if the scene is rejected. Errors of cd-solve are raised by the methods of `Run`.

    Examples
    --------
    >>> with start("scene.ron", "CASE", threads=2) as run:            # doctest: +SKIP
    ...     for snapshot in run.follow():
    ...         print(snapshot.time, snapshot.velocities.std())
    """
    folder = Path(folder)
    if resume and (force or scene is not None):
        raise CdError("resume: together with a scene or force; expected the scene None, and force False")
    if scene is None:
        if settings:
            raise CdError("settings: without a scene; expected the scene that they change")
    else:
        if not force and snapshot_paths(folder / "OUTBOX"):
            raise CdError(f"{folder}: results: exist; use force=True to remove them, or scene None with resume=True")
        changes = [f"--set={path}={ron(value)}" for path, value in (settings or {}).items()]
        run_program("cd-pre", _scene_file(scene, folder, force), "-o", folder, *changes)
    arguments = ["--resume"] * resume + ["--force"] * force + option_flags(options)
    return Run(Case(folder), arguments)


def option_flags(options: Mapping[str, object]) -> list[str]:
    """Returns the flags of cd-solve for options by their names; None leaves an option out."""
    given = {name.replace("_", "-"): value for name, value in options.items() if value is not None}
    return [f"--{name}={value if isinstance(value, str) else ron(value)}" for name, value in given.items()]


def run(
    scene: Scene | None,
    folder: str | os.PathLike[str],
    *,
    settings: Mapping[str, object] | None = None,
    force: bool = False,
    resume: bool = False,
    post: bool = True,
    **options: object,
) -> Case:
    """Runs a scene to its end: cd-pre, cd-solve and cd-post.

    Parameters
    ----------
    scene, folder, settings, force, resume, **options
        As for `start`.
    post : bool
        Whether cd-post writes POSTPRO/series.csv. It writes no plots and no ParaView files;
        ``run_program("cd-post", folder)`` writes all.

    Returns
    -------
    Case
        The case with its results.

    Raises
    ------
    CdError
        With the message and the exit code of the program that fails.
    KeyboardInterrupt
        If the call is interrupted; cd-solve saves its last step and ends.

    Examples
    --------
    >>> case = run("scene.ron", "CASE", threads=2, steps=500)         # doctest: +SKIP
    >>> case.series()["pressure"][-1]                                 # doctest: +SKIP
    """
    with start(scene, folder, settings=settings, force=force, resume=resume, **options) as running:
        case = running.wait()
    if post:
        # 1: done, with messages, which are given as a warning.
        run_program("cd-post", case.path, "--no-plots", "--no-vtk", accept=(0, 1))
    return case


def _scene_file(scene: Scene, folder: Path, force: bool) -> Path:
    """Returns the file of the scene; writes it if the scene is not a path."""
    if isinstance(scene, os.PathLike):
        return Path(scene)
    if isinstance(scene, str) and "(" not in scene:
        return Path(scene)
    text = scene if isinstance(scene, str) else ron(scene) + "\n"
    file = folder / "scene.ron"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if file.exists() and not force and file.read_text(encoding="utf-8") != text:
            raise CdError(f"{file}: scene: another one is there; expected another folder, or force=True to replace it")
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise file_error(file, error) from error
    return file


def _content(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def _identity(path: Path) -> tuple[int, int] | None:
    """Returns numbers by which a file differs from one that replaces it; None if there is no such file."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return (status.st_ino, status.st_mtime_ns)
