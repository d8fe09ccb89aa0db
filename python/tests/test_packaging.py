"""Recipes of packages agree with Cargo.toml."""

from __future__ import annotations

import re
import unittest
from pathlib import Path

from cd_toolchain import run_program
from cd_toolchain._snapshot import FORMAT_VERSION

ROOT = Path(__file__).parents[2]


MANIFEST = (ROOT / "Cargo.toml").read_text()


class RecipeTest(unittest.TestCase):
    def test_versions(self) -> None:
        manifest = re.search(r'^version = "(.*)"', MANIFEST, re.MULTILINE)
        recipe = re.search(r'^  version: "(.*)"', (ROOT / "packaging/recipe.yaml").read_text(), re.MULTILINE)
        assert manifest and recipe
        self.assertEqual(recipe[1], manifest[1])
        for program in ["cd-pre", "cd-solve", "cd-post"]:
            self.assertEqual(run_program(program, "--version").split()[1], manifest[1])

    def test_the_module_reads_the_format_that_is_written(self) -> None:
        source = (ROOT / "formats/src/snapshot/mod.rs").read_text(encoding="utf-8")
        written = re.search(r"FORMAT_VERSION: u32 = (\d+);", source)
        assert written
        self.assertEqual(int(written[1]), FORMAT_VERSION)
