"""Reads, runs and follows cases of the CD toolchain.

A case is a folder with DATBOX (input of cd-solve), OUTBOX (its snapshots) and POSTPRO (tables of cd-post). Units are
SI: m, kg, s, N, Pa, J, rad. Axes are fixed and right-handed.

>>> import cd_toolchain
>>> case = cd_toolchain.Case("CASE")                                # doctest: +SKIP
>>> for snapshot in case.snapshots:                                 # doctest: +SKIP
...     print(snapshot.step, snapshot.time, snapshot.positions.mean(axis=0))
"""

from ._case import Case, Law, Material, SnapshotList
from ._error import CdError, CdWarning
from ._loop import Loop, Step
from ._program import find_program, run_program
from ._ron import Variant, ron
from ._run import Run, Scene, run, start
from ._snapshot import Contacts, Snapshot
from ._table import Table, read_table

__all__ = [
    "Case",
    "CdError",
    "CdWarning",
    "Contacts",
    "Law",
    "Loop",
    "Material",
    "Run",
    "Scene",
    "Snapshot",
    "SnapshotList",
    "Step",
    "Table",
    "Variant",
    "find_program",
    "read_table",
    "ron",
    "run",
    "run_program",
    "start",
]
