"""Snapshots of cd-solve: the state of all bodies and contacts after a step."""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._error import CdError, file_error

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

FORMAT_VERSION = 1
"""Number of the snapshot format that this module reads."""


class Snapshot(Mapping[str, NDArray[Any]]):
    """State after a step, read from ``OUTBOX/snapshot-NNNNNN.npz`` and its parts, if it is in parts.

    The properties give the arrays of bodies plain names. ``snapshot["body_x"]`` gives any array by its name in the
    file; docs/reference/files/snapshots.md lists them. An array is read when it is first used, has the type of the file and cannot be
    written to; use ``copy()`` to change it. N is the number of bodies, in the order of DATBOX/BODIES.DAT; walls are
    bodies.

    Parameters
    ----------
    path : path
        The file.

    Attributes
    ----------
    path : Path
        The file.
    meta : dict
        Time, options, laws, materials, ledger: the JSON text `meta` of the file.

    Raises
    ------
    CdError
        If the file is missing, truncated, or not a snapshot of a known format.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._arrays: dict[str, NDArray[Any]] = {}
        self._files = [self.path]
        with self._archive(self.path) as archive:
            self._names = [name.removesuffix(".npy") for name in archive.namelist() if name != "meta.npy"]
            text = self._read(archive, "meta").tobytes()
        try:
            meta = json.loads(text)
            self.meta: dict[str, Any] = dict(meta)
            self._step, self._time, number = int(meta["step"]), float(meta["time"]), meta["format"]
        except (ValueError, KeyError, TypeError) as error:
            raise self._error("meta", "is not that of a snapshot", "expected a file of cd-solve") from error
        if number != FORMAT_VERSION:
            expected = f"this module reads {FORMAT_VERSION}; install the module of the programs that wrote the file"
            raise self._error("meta", f"format {number}", expected)
        parts = self.meta.pop("parts", [])
        if parts:
            self._files = [self.path.with_name(f"{self.path.stem}-part-{k:06}.npz") for k in range(len(parts))]
            for path, part in zip(self._files, parts, strict=True):
                self._check_part(path, int(part["crc32"]))
            with self._archive(self._files[0]) as archive:
                self._names = [name.removesuffix(".npy") for name in archive.namelist()]

    def __repr__(self) -> str:
        return f"<Snapshot {str(self.path)!r}: step {self.step}, t = {self.time} s>"

    # The same file is the same snapshot; the comparison of a mapping would compare arrays.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, Snapshot) and self.path == other.path

    def __hash__(self) -> int:
        return hash(self.path)

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Array by its name in the file."""
        if name not in self._names:
            raise KeyError(name)
        if name not in self._arrays:
            self._arrays[name] = self._read_rows(name)
        return self._arrays[name]

    def _read_rows(self, name: str) -> NDArray[Any]:
        """Reads an array from all files that have rows of it."""
        rows = []
        for path in self._files:
            with self._archive(path) as archive:
                rows.append(self._read(archive, name))
        if len(rows) == 1:
            return rows[0]
        array = np.concatenate(rows)
        array.setflags(write=False)
        return array

    def _check_part(self, path: Path, crc32: int) -> None:
        try:
            content = path.read_bytes()
        except OSError as error:
            raise file_error(path, error) from error
        if zlib.crc32(content) != crc32:
            expected = f"expected the part that {self.path} names, as cd-solve wrote it"
            raise CdError(f"{path}: part of a snapshot: CRC-32 {zlib.crc32(content)}, not {crc32}; {expected}")

    def _error(self, subject: str, found: str, expected: str) -> CdError:
        return CdError(f"{self.path}: {subject}: {found}; {expected}")

    def _archive(self, path: Path) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(path)
        except OSError as error:
            raise file_error(path, error) from error
        except zipfile.BadZipFile as error:
            with open(path, "rb") as file:
                truncated = file.read(2) == b"PK"
            if truncated:
                raise self._error("file", "is truncated", "expected a complete snapshot; copy it again") from error
            raise self._error("file", "is not an .npz file", "expected a snapshot of cd-solve") from error

    def _read(self, archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
        """Reads an array, whose elements remain in the bytes of the file."""
        subject = f"array {name}"
        try:
            content = archive.read(f"{name}.npy")  # compares the checksum, too
            file = io.BytesIO(content)
            if np.lib.format.read_magic(file) != (1, 0):
                raise ValueError
            shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(file)
            if fortran_order or dtype.hasobject:
                raise ValueError
            return np.frombuffer(content, dtype, offset=file.tell()).reshape(shape)
        except KeyError as error:
            raise self._error(subject, "is not there", "expected a snapshot of cd-solve") from error
        except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError, RuntimeError) as error:
            raise self._error(subject, "is damaged", "expected a complete snapshot; copy it again") from error
        except OSError as error:
            raise file_error(self.path, error) from error

    def _required(self, name: str) -> NDArray[Any]:
        if name not in self._names:
            raise self._error(f"array {name}", "is not there", "expected a snapshot of cd-solve")
        return self[name]

    @property
    def step(self) -> int:
        """Number of the step; 0 is the start."""
        return self._step

    @property
    def time(self) -> float:
        """Time, s."""
        return self._time

    @property
    def ids(self) -> NDArray[np.uint64]:
        """Numbers of the bodies in BODIES.DAT, from 1, shape (N,)."""
        return self._required("body_id")

    @property
    def positions(self) -> Floats:
        """Positions of the centres of mass, m, shape (N, 3)."""
        return self._required("body_x")

    @property
    def velocities(self) -> Floats:
        """Velocities of the centres of mass, m/s, shape (N, 3)."""
        return self._required("body_v")

    @property
    def quaternions(self) -> Floats:
        """Unit quaternions w, x, y, z from the frames of the bodies to the fixed axes, shape (N, 4).

        Those of spheres are those of the start, unless the run has the option `sphere_orientation`.
        """
        return self._required("body_q")

    @property
    def frames(self) -> Floats:
        """Principal axes of the bodies as rows, in fixed axes, shape (N, 3, 3).

        They are computed from `quaternions`: ``frames[i] @ u`` are the components of a vector u along the axes of
        body i.
        """
        w, x, y, z = self.quaternions.T
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
        return np.ascontiguousarray(np.moveaxis(np.array(rows), -1, 0))

    @property
    def spins(self) -> Floats:
        """Angular velocities in fixed axes, rad/s, shape (N, 3)."""
        return self._required("body_w_world")

    @property
    def body_spins(self) -> Floats:
        """Angular velocities along the principal axes of each body, rad/s, shape (N, 3)."""
        return self._required("body_w")

    @property
    def masses(self) -> Floats:
        """Masses, kg, shape (N,)."""
        return self._required("body_mass")

    @property
    def inertias(self) -> Floats:
        """Principal moments of inertia, kg m², shape (N, 3)."""
        return self._required("body_inertia")

    @property
    def radii(self) -> Floats:
        """Radii of the spheres of equal volume, m, shape (N,)."""
        return self._required("body_radius")

    @property
    def half_lengths(self) -> Floats:
        """Half lengths of planes along their axes, m, shape (N, 3); of other bodies the radius three times."""
        return self._required("body_half_lengths")

    @property
    def shapes(self) -> NDArray[np.uint8]:
        """Shapes, shape (N,): 0 sphere, 1 plane, 2 polyhedra or other contactors, which are in BODIES.DAT."""
        return self._required("body_shape")

    @property
    def driven(self) -> NDArray[np.uint8]:
        """Imposed components of the velocity, shape (N,): bit k is set if component k is imposed."""
        return self._required("body_driven")

    @property
    def walls(self) -> Booleans:
        """True for walls, shape (N,): bodies with an imposed velocity, in all components or some, and planes."""
        return np.asarray(np.logical_or(self.driven > 0, self.shapes == 1))

    @property
    def grains(self) -> Booleans:
        """True for grains, shape (N,): bodies that are no walls."""
        return np.logical_not(self.walls)

    @property
    def colours(self) -> NDArray[np.str_]:
        """Names of the colours of the bodies, shape (N,)."""
        return _names(self.meta["colours"], self._required("body_colour"))

    @property
    def materials(self) -> NDArray[np.str_]:
        """Names of the materials of the bodies, shape (N,); `Case.materials` has their densities."""
        return _names([material["name"] for material in self.meta["materials"]], self._required("body_material"))

    @property
    def contacts(self) -> Contacts:
        """Contacts of the last step."""
        return Contacts(self)


class Contacts:
    """Contacts that the last step listed, where they were detected: C rows, sorted by bodies and features.

    Parameters
    ----------
    snapshot : Snapshot
        The snapshot whose contacts these are.
    """

    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def __len__(self) -> int:
        return len(self.gaps)

    def _array(self, name: str) -> NDArray[Any]:
        return self._snapshot._required(f"contact_{name}")

    @property
    def bodies(self) -> NDArray[np.uint32]:
        """Rows of the candidate and of the antagonist in the arrays of bodies, shape (C, 2)."""
        return self._array("body")

    @property
    def features(self) -> NDArray[np.uint32]:
        """Features of the candidate and of the antagonist that touch, shape (C, 2); docs/reference/files/snapshots.md has the codes."""
        return self._array("feature")

    @property
    def points(self) -> Floats:
        """Points of contact, m, shape (C, 3)."""
        return self._array("point")

    @property
    def frames(self) -> Floats:
        """Rows n, t, s in fixed axes, shape (C, 3, 3); n points from the antagonist to the candidate, n × t = s."""
        return self._array("frame")

    @property
    def gaps(self) -> Floats:
        """Gaps, m, shape (C,), positive apart."""
        return self._array("gap")

    @property
    def local_forces(self) -> Floats:
        """Forces on the candidate along n, t, s, N, shape (C, 3): means over the step."""
        return self._array("force")

    @property
    def forces(self) -> Floats:
        """Forces on the candidate in fixed axes, N, shape (C, 3): means over the step."""
        return np.asarray(np.einsum("ci,cij->cj", self.local_forces, self.frames))

    @property
    def impulses(self) -> Floats:
        """Impulses on the candidate along n, t, s in the step, N s, shape (C, 3)."""
        return self._array("impulse")

    @property
    def velocities(self) -> Floats:
        """Velocities of the candidate relative to the antagonist along n, t, s at the step's end, m/s, (C, 3)."""
        return self._array("velocity")

    @property
    def statuses(self) -> NDArray[np.uint8]:
        """Statuses, shape (C,): 0 no contact, 1 stick, 2 slide."""
        return self._array("status")

    @property
    def laws(self) -> NDArray[np.str_]:
        """Nicknames of the laws, shape (C,); `Case.laws` has their parameters."""
        return _names([law["nickname"] for law in self._snapshot.meta["laws"]], self._array("law"))


def _names(names: list[str], indices: NDArray[Any]) -> NDArray[np.str_]:
    """Returns the names at these indices."""
    return np.asarray(np.array(names, dtype=np.str_)[indices])
