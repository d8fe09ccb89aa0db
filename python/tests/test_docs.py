"""The blocks of code of docs/reference/python.md run, and print what the page says."""

from __future__ import annotations

import contextlib
import inspect
import io
import os
import re
from pathlib import Path

import cd_toolchain
from scenes import CaseTest

NUMBER = r"\d+\.\d+(?:e[+-]\d+)?"
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "python.md"


class DocsTest(CaseTest):
    def test_the_blocks_of_the_page(self) -> None:
        blocks = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        names: dict[str, object] = {}
        printed = ""
        for kind, text in blocks:
            if kind == "python":
                output = io.StringIO()
                with contextlib.redirect_stdout(output):
                    exec(text, names)
                printed = output.getvalue()
                self.assertTrue(printed or "print(" not in text)
            else:
                self.assertEqual(kind, "text")
                self.compare(text, printed)
        self.assertGreater(len(blocks), 10)

    def compare(self, text: str, printed: str) -> None:
        """Compares words; numbers with points by 10 %, since the collapse of a cloud amplifies the last bits."""
        self.assertEqual(re.sub(NUMBER, "0.0", text), re.sub(NUMBER, "0.0", printed), printed)
        for expected, found in zip(re.findall(NUMBER, text), re.findall(NUMBER, printed)):
            self.assertAlmostEqual(float(found), float(expected), delta=0.1 * abs(float(expected)), msg=printed)

    def test_the_page_names_all_that_is_public(self) -> None:
        page = PAGE.read_text(encoding="utf-8")
        for name in cd_toolchain.__all__:
            self.assertIsNotNone(re.search(rf"\b{name}\b", page), name)
        for kind in [cd_toolchain.Case, cd_toolchain.Snapshot, cd_toolchain.Contacts, cd_toolchain.Run]:
            for name, member in vars(kind).items():
                if name.startswith("_"):
                    continue
                self.assertIsNotNone(re.search(rf"`{name}[(`]", page), f"{kind.__name__}.{name}")
                self.assertTrue(inspect.getdoc(member), f"{kind.__name__}.{name}")
