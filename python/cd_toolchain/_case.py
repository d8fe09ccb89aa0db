"""Cases: the folder in which the programs read and write."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from ._error import CdError
from ._snapshot import Snapshot
from ._table import Table, read_table

_SNAPSHOT_NAME = re.compile(r"snapshot-(\d{6,})\.npz")


@dataclass(frozen=True)
class Material:
    """Material of a case.

    Attributes
    ----------
    name : str
        Name, up to five characters.
    density : float
        kg/m³.
    """

    name: str
    density: float


@dataclass(frozen=True)
class Law:
    """Contact law of a case, as in force at its last snapshot.

    Attributes
    ----------
    nickname : str
        Name in the scene.
    kind : str
        Law, such as ``IQS_CLB``.
    parameters : tuple of float
        In the order and the units of docs/reference/laws.md.
    """

    nickname: str
    kind: str
    parameters: tuple[float, ...]


class SnapshotList(Sequence[Snapshot]):
    """Snapshots of an OUTBOX in the order of their steps; a file is opened when its item is used.

    Parameters
    ----------
    outbox : Path
        Folder; it may be missing.
    """

    def __init__(self, outbox: Path) -> None:
        self._paths = snapshot_paths(outbox)
        self._steps = list(self._paths)

    def __repr__(self) -> str:
        return f"<SnapshotList of {len(self)} snapshots>"

    @property
    def steps(self) -> NDArray[np.int64]:
        """Numbers of the steps, shape (len,), by the names of the files; no file is opened."""
        return np.array(self._steps, dtype=np.int64)

    def __len__(self) -> int:
        return len(self._steps)

    @overload
    def __getitem__(self, index: int) -> Snapshot: ...
    @overload
    def __getitem__(self, index: slice) -> list[Snapshot]: ...
    def __getitem__(self, index: int | slice) -> Snapshot | list[Snapshot]:
        """Snapshot by its position in the list, from 0, or negative from the end."""
        if isinstance(index, slice):
            return [Snapshot(self._paths[step]) for step in self._steps[index]]
        return Snapshot(self._paths[self._steps[index]])

    def at_step(self, step: int) -> Snapshot:
        """Returns the snapshot after a step.

        Raises
        ------
        CdError
            If there is none; the message names the nearest.
        """
        if step not in self._paths:
            nearest = min(self._steps, key=lambda other: abs(other - step), default=None)
            expected = "run cd-solve first" if nearest is None else f"the nearest is that of step {nearest}"
            raise CdError(f"step {step}: has no snapshot; {expected}")
        return Snapshot(self._paths[step])


class Case:
    """Folder of a case, with OUTBOX from cd-solve and, for `series`, POSTPRO from cd-post.

    Parameters
    ----------
    path : path
        The folder; it may still be without results.

    Attributes
    ----------
    path : Path
        The folder.

    Raises
    ------
    CdError
        If there is no such folder, or if it is not that of a case.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if self.path.is_file():
            hint = "; Snapshot(path) reads a single snapshot" if _SNAPSHOT_NAME.fullmatch(self.path.name) else ""
            raise CdError(f"{self.path}: file: is not a folder; expected the folder of a case{hint}")
        if not self.path.is_dir():
            raise CdError(f"{self.path}: folder: there is no such folder; expected the folder of a case")
        if self.path.name in ("OUTBOX", "DATBOX", "POSTPRO", "DISPLAY") or snapshot_paths(self.path):
            raise CdError(f"{self.path}: folder: is a part of a case; expected the case folder, which contains it")

    def __repr__(self) -> str:
        return f"Case({str(self.path)!r})"

    @property
    def snapshots(self) -> SnapshotList:
        """Snapshots that are there now, in the order of their steps."""
        return SnapshotList(self.path / "OUTBOX")

    def _last(self) -> Snapshot:
        snapshots = self.snapshots
        if not snapshots:
            raise CdError(f"{self.path / 'OUTBOX'}: folder: has no snapshots; run cd-solve {self.path} first")
        return snapshots[-1]

    @property
    def meta(self) -> dict[str, Any]:
        """Time, options, laws, materials and ledger of the last snapshot.

        docs/reference/files/snapshots.md lists the fields.
        """
        return self._last().meta

    @property
    def materials(self) -> list[Material]:
        """Materials, with their densities in kg/m³."""
        return [Material(item["name"], item["density"]) for item in self.meta["materials"]]

    @property
    def laws(self) -> list[Law]:
        """Contact laws as in force at the last snapshot."""
        return [Law(item["nickname"], item["kind"], tuple(item["parameters"])) for item in self.meta["laws"]]

    @property
    def walls(self) -> NDArray[np.uint64]:
        """Numbers of the bodies that are walls, as in `Snapshot.ids`, shape (number of walls,)."""
        last = self._last()
        return last.ids[last.walls]

    def series(self) -> Table:
        """Observables against time, from POSTPRO/series.csv.

        Returns
        -------
        dict of str to array, shape (snapshots,)
            Columns by name, `step`, `time`, `Z`, `nu`, `pressure` ...; docs/reference/observables/ defines them. NaN where a
            value is not defined.

        Raises
        ------
        CdError
            If cd-post has not run.
        """
        return self._table("POSTPRO/series.csv", "cd-post")

    def steps(self) -> Table:
        """Cost, energies and errors of each step, from OUTBOX/steps.csv.

        Returns
        -------
        dict of str to array, shape (rows,)
            Columns by name; docs/reference/files/logs.md defines them.

        Raises
        ------
        CdError
            If cd-solve has not run.
        """
        return self._table("OUTBOX/steps.csv", "cd-solve")

    def _table(self, name: str, program: str) -> Table:
        path = self.path / name
        if not path.exists():
            raise CdError(f"{path}: table: there is no such file; run {program} {self.path} first")
        return read_table(path)

    def follow(self, poll: float = 0.5, silence: float = 60.0) -> Iterator[Snapshot]:
        """Yields the snapshots of a run of another process: those that are there, then each new one as it appears.

        The iteration ends when the run has reached its last step. If no run begins, it ends after `silence`.

        Parameters
        ----------
        poll : float
            Time between two reads of the folder, s.
        silence : float
            Time without a new result after which the run counts as ended, s. cd-solve writes at least every 30 s,
            except in longer steps; on Unix, on one machine, a run in a longer step is recognised by its lock of OUTBOX.

        Raises
        ------
        CdError
            If a run that has written results is silent before its last step.
        """
        outbox = self.path / "OUTBOX"
        last_step, changed, last_sign = -1, False, self._last_change()
        active = time.monotonic()
        while True:
            done = self._is_complete() and not is_locked(outbox)
            for step, path in snapshot_paths(outbox).items():
                if step > last_step:
                    last_step = step
                    yield Snapshot(path)
            if done:
                return
            sign = self._last_change()
            if sign != last_sign:
                changed, last_sign, active = True, sign, time.monotonic()
            elif time.monotonic() - active > silence:
                if is_locked(outbox):
                    active = time.monotonic()
                elif changed:
                    raise CdError(
                        f"{self.path}: run: no new result for {silence} s, last snapshot that of step {last_step}; "
                        f"cd-solve {self.path} --resume continues if the run has ended"
                    )
                else:
                    return
            time.sleep(poll)

    def _is_complete(self) -> bool:
        """Whether cd-solve has ended at its last step: ERRORS.csv is written then, after the last snapshot."""
        paths = list(snapshot_paths(self.path / "OUTBOX").values())
        return bool(paths) and change_time(self.path / "ERRORS.csv") >= change_time(paths[-1])

    def _last_change(self) -> int:
        """Time of the last change of the results, ns; -1 without results."""
        outbox = self.path / "OUTBOX"
        files = [outbox / "steps.csv", self.path / "TIMER.csv", *list(snapshot_paths(outbox).values())[-1:]]
        return max(map(change_time, files))


def snapshot_paths(outbox: Path) -> dict[int, Path]:
    """Returns the complete snapshots of a folder by their steps, in ascending order."""
    try:
        matches = [_SNAPSHOT_NAME.fullmatch(name) for name in os.listdir(outbox)]
    except (FileNotFoundError, NotADirectoryError):
        return {}
    return dict(sorted((int(match[1]), outbox / match[0]) for match in matches if match))


def change_time(path: Path) -> int:
    """Returns the time of the last change of a file, ns; -1 if there is no such file."""
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return -1


def is_locked(outbox: Path) -> bool:
    """Whether a cd-solve holds its lock of the folder; False where folders cannot be locked."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        folder = os.open(outbox, os.O_RDONLY)
    except OSError:
        return False
    try:
        # Closing the folder releases the lock.
        fcntl.flock(folder, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(folder)
    return False
