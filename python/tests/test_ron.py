"""Python values as RON."""

from __future__ import annotations

import doctest
import enum

import numpy as np

import cd_toolchain
from cd_toolchain import CdError, Variant, ron, run_program
from scenes import DROP, DROP_TEXT, CaseTest


class Preset(enum.Enum):
    draft = 1


class RonTest(CaseTest):
    def test_values(self) -> None:
        values: list[tuple[object, str]] = [
            (None, "None"),
            (True, "true"),
            (np.bool_(False), "false"),
            (3, "3"),
            (np.int64(-3), "-3"),
            (0.1 + 0.2, "0.30000000000000004"),
            (np.float64(6.6743e-11), "6.6743e-11"),
            ('a "b"\\\n\x01', '"a \\"b\\"\\\\\\n\\u{1}"'),
            (Preset.draft, "draft"),
            ([], "[]"),
            ((), "()"),
            ({}, "()"),
            ([(1, 2.0), (3, 4.0)], "[(1, 2.0), (3, 4.0)]"),
            (Variant("Harmonic")(amplitude=0.8, omega=8), "Harmonic(amplitude: 0.8, omega: 8)"),
        ]
        for value, text in values:
            self.assertEqual(ron(value), text)

    def test_long_values_are_broken_into_lines(self) -> None:
        text = ron({"list": [0.123456789012] * 12, "name": "x"})
        self.assertTrue(text.startswith("(\n    list: [\n        0.123456789012,\n"))
        self.assertTrue(text.endswith("    ],\n    name: \"x\",\n)"))

    def test_values_that_are_no_ron(self) -> None:
        for value, message in [
            (float("nan"), "ron: nan; expected a finite number"),
            (np.zeros(3), "tolist"),
            ({1: 2}, "expected a name"),
            ({"a b": 2}, "'a b'"),
            ({1.0, 2.0}, "type set; expected dict, list"),
        ]:
            with self.assertRaisesRegex(CdError, message):
                ron(value)
        with self.assertRaisesRegex(CdError, "AddSpin: values and named fields"):
            Variant("AddSpin")(1, x=2)

    def test_cd_pre_reads_the_same_scene(self) -> None:
        boxes = []
        for name, text in [("data", ron(DROP)), ("text", DROP_TEXT)]:
            (self.folder / name).mkdir()
            (self.folder / name / "scene.ron").write_text(text)
            run_program("cd-pre", self.folder / name / "scene.ron")
            # SHA256SUMS has that of COMPUTE.RON, which begins with the checksum of the scene.
            files = sorted(file for file in (self.folder / name / "DATBOX").iterdir() if file.name != "SHA256SUMS")
            contents = [[line for line in file.read_text().splitlines() if "checksum" not in line] for file in files]
            boxes.append(dict(zip([file.name for file in files], contents)))
        self.assertEqual(*boxes)

    def test_cd_pre_reads_all_digits_and_signs_of_numbers(self) -> None:
        # The options of COMPUTE.RON are written with all digits.
        for number in [1.2345678901234567e-5, 1e-300, 1e22, 123456789.123456789]:
            scene = {**DROP, "compute": {"dt": 1.0, "gravity_constant": number, "self_gravity": True}}
            (self.folder / "scene.ron").write_text(ron(scene))
            run_program("cd-pre", self.folder / "scene.ron")
            options = (self.folder / "DATBOX/COMPUTE.RON").read_text()
            written = options.split("gravity_constant:")[1].split(",")[0]
            self.assertEqual(float(written), number)

    def test_examples_of_the_docstrings(self) -> None:
        for module in [cd_toolchain, cd_toolchain._ron, cd_toolchain._run]:
            result = doctest.testmod(module)
            self.assertEqual(result.failed, 0)
