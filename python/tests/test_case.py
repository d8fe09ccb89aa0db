"""Cases and snapshots, read and compared with closed forms and with numpy.load."""

from __future__ import annotations

import math
import shutil
import tempfile
import unittest
from pathlib import Path
from typing import ClassVar

import numpy as np

from cd_toolchain import Case, CdError, Law, Material, Snapshot, Variant, run
from scenes import DENSITY, DROP, GRAVITY, RADIUS, CaseTest

MASS = DENSITY * 4 / 3 * math.pi * RADIUS**3


class ReadTest(unittest.TestCase):
    case: ClassVar[Case]

    @classmethod
    def setUpClass(cls) -> None:
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.case = run(DROP, Path(folder.name) / "drop", threads=1)

    def test_the_list_of_snapshots(self) -> None:
        snapshots = self.case.snapshots
        self.assertEqual(snapshots.steps.tolist(), [0, 50, 100, 150, 200])
        self.assertEqual([snapshot.step for snapshot in snapshots], [0, 50, 100, 150, 200])
        self.assertEqual([snapshot.step for snapshot in snapshots[::-2]], [200, 100, 0])
        self.assertEqual(snapshots.at_step(50), snapshots[1])
        self.assertAlmostEqual(snapshots[-1].time, 0.2, delta=1e-15)
        self.assertIn("step 200, t = 0.2 s", repr(snapshots[-1]))
        with self.assertRaisesRegex(CdError, "step 60: has no snapshot; the nearest is that of step 50"):
            snapshots.at_step(60)
        with self.assertRaises(IndexError):
            snapshots[5]

    def test_arrays_are_those_of_the_file(self) -> None:
        for snapshot in self.case.snapshots:
            with np.load(snapshot.path) as expected:
                self.assertEqual(set(snapshot), set(expected.files) - {"meta"})
                for name, array in snapshot.items():
                    self.assertEqual(array.dtype, expected[name].dtype)
                    np.testing.assert_array_equal(array, expected[name], strict=True)

    def test_properties_are_arrays_of_the_file(self) -> None:
        snapshot = self.case.snapshots[-1]
        for name, array in [
            ("body_id", snapshot.ids),
            ("body_x", snapshot.positions),
            ("body_v", snapshot.velocities),
            ("body_q", snapshot.quaternions),
            ("body_w", snapshot.body_spins),
            ("body_w_world", snapshot.spins),
            ("body_mass", snapshot.masses),
            ("body_inertia", snapshot.inertias),
            ("body_radius", snapshot.radii),
            ("body_half_lengths", snapshot.half_lengths),
            ("body_shape", snapshot.shapes),
            ("body_driven", snapshot.driven),
            ("contact_body", snapshot.contacts.bodies),
            ("contact_feature", snapshot.contacts.features),
            ("contact_point", snapshot.contacts.points),
            ("contact_frame", snapshot.contacts.frames),
            ("contact_gap", snapshot.contacts.gaps),
            ("contact_force", snapshot.contacts.local_forces),
            ("contact_impulse", snapshot.contacts.impulses),
            ("contact_velocity", snapshot.contacts.velocities),
            ("contact_status", snapshot.contacts.statuses),
        ]:
            self.assertIs(array, snapshot[name])
        with self.assertRaises(ValueError):
            snapshot.positions[0, 0] = 1.0
        with self.assertRaises(KeyError):
            snapshot["body_y"]

    def test_free_fall_and_rest(self) -> None:
        snapshots = self.case.snapshots
        # The higher bead touches the plate after 0.064 s. With theta = 1/2 free fall is exact but for rounding.
        fall = 0.12 - GRAVITY / 2 * snapshots[1].time ** 2
        self.assertAlmostEqual(snapshots[1].positions[1, 2], fall, delta=1e-14)
        last = snapshots[-1]
        np.testing.assert_allclose(last.masses[last.grains], MASS, rtol=1e-6)
        self.assertEqual(len(last.contacts), 2)
        # BODIES.DAT has eight digits of radius and density.
        np.testing.assert_allclose(last.contacts.forces, [[0.0, 0.0, MASS * GRAVITY]] * 2, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(last.contacts.points, [[0, 0, 0], [1, 0, 0]], atol=1e-4)
        self.assertEqual(last.contacts.laws.tolist(), ["iqsc0"] * 2)

    def test_names_and_walls(self) -> None:
        last = self.case.snapshots[-1]
        self.assertEqual(last.grains.tolist(), [True, True, False])
        self.assertEqual(last.colours.tolist(), ["BLUEx", "BLUEx", "FLOOR"])
        self.assertEqual(last.materials.tolist(), ["GLASS"] * 3)
        self.assertEqual(self.case.walls.tolist(), [3])
        self.assertEqual(self.case.materials, [Material("GLASS", DENSITY)])
        self.assertEqual(self.case.laws, [Law("iqsc0", "IQS_CLB", (0.5,))])
        self.assertEqual(self.case.meta["step"], 200)

    def test_tables(self) -> None:
        series, steps = self.case.series(), self.case.steps()
        self.assertEqual(series["step"].tolist(), [0, 50, 100, 150, 200])
        self.assertEqual(steps["step"].tolist(), list(range(1, 201)))
        last = self.case.snapshots[-1]
        kinetic = np.sum(last.masses * np.sum(last.velocities**2, axis=1) / 2)
        self.assertAlmostEqual(steps["kinetic_energy"][-1], kinetic, delta=1e-12)
        self.assertTrue(np.isnan(series["Z_no_rattlers"]).all())


class FrameTest(CaseTest):
    def test_axes_of_bodies_that_turn(self) -> None:
        block = {
            "material": "GLASS",
            "colour": "BLUEx",
            "shape": Variant("Box")(lengths=(0.2, 0.3, 0.4)),
            "placement": Variant("List")(positions=[(0.0, 0.0, 1.0), (1.0, 0.0, 1.0)]),
            "spin": (1.0, 2.0, 3.0),
        }
        scene = {**DROP, "grains": [block], "gravity": (0, 0, 0)}
        last = run(scene, self.folder / "turn", post=False, steps=10).snapshots[-1]
        frames = last.frames
        np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), [np.eye(3)] * 3, atol=1e-14)
        np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-14)
        np.testing.assert_allclose(np.einsum("nij,nj->ni", frames, last.spins), last.body_spins, atol=1e-12)
        self.assertGreater(abs(last.quaternions[last.grains, 1:]).min(), 1e-3)


class PartTest(CaseTest):
    def test_parts_are_the_whole(self) -> None:
        whole = run(DROP, self.folder / "whole", steps=200, post=False).snapshots[-1]
        case = run(DROP, self.folder / "parts", steps=200, part_bodies=2)
        self.assertEqual(case.snapshots.steps.tolist(), [0, 50, 100, 150, 200])
        last = case.snapshots[-1]
        self.assertEqual((set(last), last.meta), (set(whole), whole.meta))
        for name, array in whole.items():
            np.testing.assert_array_equal(last[name], array, strict=True)
        with self.assertRaises(ValueError):
            last.positions[0, 0] = 1.0
        parts = sorted(last.path.parent.glob("snapshot-000200-part-*"))
        self.assertEqual(len(parts), 2)
        parts[1].write_bytes(parts[0].read_bytes())
        with self.assertRaisesRegex(CdError, "part-000001.npz: part of a snapshot: CRC-32 .*; expected the part that"):
            Snapshot(last.path)


class RejectedFileTest(CaseTest):
    def setUp(self) -> None:
        super().setUp()
        self.case = run(DROP, self.folder / "drop", steps=1, post=False)
        self.file = self.case.snapshots[-1].path

    def rejected(self, message: str) -> None:
        with self.assertRaisesRegex(CdError, message) as raised:
            snapshot = Snapshot(self.file)
            for name in snapshot:
                snapshot[name]
        self.assertTrue(str(raised.exception).startswith(f"{self.file}: "))

    def test_truncated_files(self) -> None:
        content = self.file.read_bytes()
        for length in [2, 100, len(content) // 2, len(content) - 1]:
            self.file.write_bytes(content[:length])
            self.rejected("file: is truncated")

    def test_foreign_files(self) -> None:
        for content in [b"", b"x", b"no archive" * 100]:
            self.file.write_bytes(content)
            self.rejected("file: is not an .npz file")
        np.savez(self.file, x=np.zeros(3))
        self.rejected("array meta: is not there")
        np.savez(self.file, meta=np.frombuffer(b"[]", dtype=np.uint8))
        self.rejected("meta: is not that of a snapshot")
        np.savez(self.file, meta=np.frombuffer(b'{"step":1,"time":0,"format":1}', dtype=np.uint8))
        with self.assertRaisesRegex(CdError, "array body_x: is not there"):
            Snapshot(self.file).positions

    def test_later_formats(self) -> None:
        np.savez(self.file, meta=np.frombuffer(b'{"step":1,"time":0,"format":2}', dtype=np.uint8))
        self.rejected("meta: format 2; this module reads 1")

    def test_damaged_arrays(self) -> None:
        content = self.file.read_bytes()
        at = content.index(Snapshot(self.file).masses.tobytes())
        self.file.write_bytes(content[:at] + b"\x00" + content[at + 1 :])
        self.rejected("array body_mass: is damaged")

    def test_files_that_vanish(self) -> None:
        snapshot = Snapshot(self.file)
        self.file.unlink()
        with self.assertRaisesRegex(CdError, "there is no such file"):
            snapshot.positions

    def test_folders_that_are_no_cases(self) -> None:
        shutil.copy(self.file, self.folder / "snapshot-000001.npz")
        for path, message in [
            (self.folder / "none", "there is no such folder"),
            (self.file, "Snapshot.path. reads a single snapshot"),
            (self.case.path / "scene.ron", "is not a folder"),
            (self.case.path / "OUTBOX", "expected the case folder, which contains it"),
            (self.folder, "is a part of a case"),
        ]:
            with self.assertRaisesRegex(CdError, message):
                Case(path)

    def test_cases_without_results(self) -> None:
        shutil.rmtree(self.case.path / "OUTBOX")
        self.assertEqual(len(self.case.snapshots), 0)
        with self.assertRaisesRegex(CdError, "has no snapshots; run cd-solve .*drop first"):
            self.case.meta
        with self.assertRaisesRegex(CdError, "steps.csv: table: there is no such file; run cd-solve"):
            self.case.steps()
        with self.assertRaisesRegex(CdError, "series.csv: table: there is no such file; run cd-post"):
            self.case.series()
        with self.assertRaisesRegex(CdError, "step 1: has no snapshot; run cd-solve"):
            self.case.snapshots.at_step(1)
