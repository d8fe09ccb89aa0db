"""Runs whose forces are set at each step."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from ._case import Case
from ._error import CdError
from ._program import check_exit, find_program
from ._run import option_flags

Numbers: TypeAlias = npt.NDArray[np.float64]

_MAGIC = b"CDSTEPS1"


@dataclass(frozen=True)
class Step:
    """State at the start of a step, and the forces in it. Rows are the bodies of BODIES.DAT, N of them.

    Attributes
    ----------
    step, time : int, float
        Number of the last step, and the time, s.
    dt : float
        Length of the next step, s.
    positions, velocities : (N, 3) arrays
        Of the centres of mass, m and m/s.
    quaternions : (N, 4) array
        w, x, y, z, from the body's frame to the fixed axes.
    spins : (N, 3) array
        Angular velocities in fixed axes, rad/s.
    forces, torques : (N, 3) arrays
        To be set: forces at the centres of mass, N, and torques, N m, in fixed axes, constant over the step; 0 at its
        start. Components of the velocity that are imposed do not depend on them.
    """

    step: int
    time: float
    dt: float
    positions: Numbers
    quaternions: Numbers
    velocities: Numbers
    spins: Numbers
    forces: Numbers
    torques: Numbers


class Loop:
    """cd-solve at work, with forces from this program in each step; iterating it yields each `Step`.

    The run ends when the iteration does. If the loop is left earlier, cd-solve writes a snapshot and ends, and
    ``resume=True`` continues. The results are those of any run, in `case`.

    Parameters
    ----------
    case : Case or path
        Case with a DATBOX.
    force : bool
        Removes the results of an earlier run. Without it a case that has results is rejected.
    resume : bool
        Continues from the last snapshot.
    **options : value
        Options of cd-solve, as for `start`.

    Attributes
    ----------
    case : Case
        The case, whose results can be read at any time.

    Raises
    ------
    CdError
        While iterating, with the message and the exit code of cd-solve, if it fails or is stopped.

    Examples
    --------
    >>> for step in Loop("CASE", steps=500):                          # doctest: +SKIP
    ...     step.forces[:] = -0.1 * step.velocities
    """

    def __init__(
        self, case: Case | str | os.PathLike[str], *, force: bool = False, resume: bool = False, **options: object
    ) -> None:
        self.case = case if isinstance(case, Case) else Case(case)
        arguments = ["--step-loop"] + ["--resume"] * resume + ["--force"] * force + option_flags(options)
        printed = tempfile.mkdtemp()
        weakref.finalize(self, shutil.rmtree, printed, ignore_errors=True)
        self._messages = Path(printed, "messages")
        command = [find_program("cd-solve"), os.fspath(self.case.path), *arguments]
        with open(self._messages, "wb") as messages:
            # In a session of its own, as in `Run`: Ctrl-C ends this program, which closes the pipe.
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=messages, start_new_session=True
            )
        self._started = False

    def __iter__(self) -> Iterator[Step]:
        """Yields the state at the start of each step; the forces that are set are used in this step."""
        if self._started:
            raise CdError("loop: has been used; expected a new Loop")
        self._started = True
        try:
            header = self._read(len(_MAGIC) + 8)
            if header is not None:
                if header[: len(_MAGIC)] != _MAGIC:
                    raise CdError("cd-solve: step loop: another format; expected the cd-solve of this module's version")
                bodies = int.from_bytes(header[len(_MAGIC) :], "little")
                while (frame := self._read(8 * (3 + 13 * bodies))) is not None:
                    step = _step(frame, bodies)
                    yield step
                    self._write(np.hstack([step.forces, step.torques]).astype("<f8").tobytes())
            self._finish(stopped=False)
        finally:
            self.stop()

    def __enter__(self) -> Loop:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def output(self) -> str:
        """Text that cd-solve has printed so far: messages, lines of progress, at the end the summary."""
        return self._messages.read_text(encoding="utf-8", errors="replace")

    def stop(self) -> Case:
        """Ends the run, if it has not ended; cd-solve first writes a snapshot.

        Returns
        -------
        Case
            The case, with the results so far.
        """
        self._finish(stopped=True)
        return self.case

    def _finish(self, stopped: bool) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except BrokenPipeError:
                    pass  # it has ended
        exit_code = self._process.wait()
        if not stopped:
            messages = [line for line in self.output.splitlines() if line.startswith("cd-solve: ")]
            if exit_code == 0:
                messages = [line for line in messages if line.startswith(("cd-solve: warning:", "cd-solve: step"))]
            check_exit("cd-solve", exit_code, "\n".join(messages))

    def _read(self, size: int) -> bytes | None:
        """Returns the next bytes of cd-solve, or None if it has ended."""
        assert self._process.stdout is not None
        data = self._process.stdout.read(size)
        return data if len(data) == size else None

    def _write(self, data: bytes) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(data)
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # its end is noticed by the next read


def _step(frame: bytes, bodies: int) -> Step:
    """Returns the step of a frame: step, time, dt, positions, quaternions, velocities, spins."""
    numbers = np.frombuffer(frame, "<f8")
    parts = np.split(numbers[3:], np.cumsum([3 * bodies, 4 * bodies, 3 * bodies]))
    positions, quaternions, velocities, spins = [part.reshape(bodies, -1) for part in parts]
    forces, torques = np.zeros((bodies, 3)), np.zeros((bodies, 3))
    step, time, dt = numbers[:3]
    return Step(int(step), float(time), float(dt), positions, quaternions, velocities, spins, forces, torques)
