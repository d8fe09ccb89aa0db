"""Recipes of packages agree with Cargo.toml."""

from __future__ import annotations

import re
import unittest
from pathlib import Path

from cd_toolchain import run_program

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

    def test_the_image_has_all_members_of_the_workspace(self) -> None:
        members = re.search(r"^members = \[(.*)\]", MANIFEST, re.MULTILINE)
        copied = re.search(r"^    (.*) python /src/$", (ROOT / "packaging/apptainer.def").read_text(), re.MULTILINE)
        assert members and copied
        self.assertLessEqual(set(re.findall(r'"(.*?)"', members[1])), set(copied[1].split()))
