"""Tables of the programs."""

from __future__ import annotations

import numpy as np

from cd_toolchain import CdError, Table, read_table
from scenes import CaseTest


class TableTest(CaseTest):
    def read(self, text: str) -> Table:
        self.file = self.folder / "table.csv"
        self.file.write_text(text)
        return read_table(self.file)

    def test_types_of_columns(self) -> None:
        table = self.read("step,x,gap,name\n1,0e0,,tol\n2,1.7976931348623157e308,0.1,\n")
        self.assertEqual([column.dtype.kind for column in table.values()], ["i", "f", "f", "U"])
        np.testing.assert_array_equal(table["x"], [0.0, 1.7976931348623157e308])
        np.testing.assert_array_equal(table["gap"], [np.nan, 0.1])
        self.assertEqual(table["name"].tolist(), ["tol", ""])

    def test_tables_of_numbers(self) -> None:
        table = self.read("n,x,y,z\n-1,1e-1,,\n2,,3,0.30000000000000004\n")
        self.assertEqual([column.dtype.kind for column in table.values()], ["i", "f", "f", "f"])
        rows = np.array(list(table.values())).T
        np.testing.assert_array_equal(rows, [[-1, 0.1, np.nan, np.nan], [2, np.nan, 3, 0.30000000000000004]])
        # A column that begins as integers.
        self.assertEqual(self.read("x\n1\n0.5\n")["x"].tolist(), [1.0, 0.5])

    def test_an_incomplete_last_row_is_left_out(self) -> None:
        self.assertEqual(self.read("step,x\n1,0.5\n2,0.")["step"].tolist(), [1])
        self.assertEqual(len(self.read("step,x\n")["x"]), 0)

    def test_files_that_are_no_tables(self) -> None:
        with self.assertRaisesRegex(CdError, "table.csv: table: is empty"):
            self.read("")
        with self.assertRaisesRegex(CdError, "table.csv:3: row: 1 fields; expected 2"):
            self.read("step,x\n1,0.5\n2\n3,0.5\n")
        self.file.write_bytes(b"\xff\xfe")
        with self.assertRaisesRegex(CdError, "is not text"):
            read_table(self.file)
        with self.assertRaisesRegex(CdError, "missing.csv: file: there is no such file"):
            read_table(self.folder / "missing.csv")
