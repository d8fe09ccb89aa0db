"""Runs whose forces are set at each step."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import unittest
import warnings
from pathlib import Path

import numpy as np

from cd_toolchain import Case, CdError, CdWarning, Loop, Variant, ron, run_program
from scenes import DROP, RADIUS, CaseTest

LONG = 100_000_000
"""Number of steps that no test waits for."""

DRAG = 0.7
"""Coefficient of the linear drag, kg/s."""

FLYING = {
    **DROP,
    "gravity": (0.0, 0.0, 0.0),
    "grains": [
        {
            "material": "GLASS",
            "colour": "BLUEx",
            "sizes": Variant("Single")(RADIUS),
            "placement": Variant("List")(positions=[(0.0, 0.0, 5.0), (1.0, 0.0, 6.0)]),
            "velocity": (1.0, -2.0, 0.5),
        }
    ],
}
"""Two beads that fly apart from everything."""


class LoopTest(CaseTest):
    def made(self, scene: object, name: str = "case") -> Path:
        file = self.folder / f"{name}.ron"
        file.write_text(ron(scene))
        run_program("cd-pre", file, "-o", self.folder / name)
        return self.folder / name

    def test_linear_drag(self) -> None:
        case = self.made(FLYING)
        times = []
        for step in Loop(case, steps=200, threads=1):
            step.forces[:] = -DRAG * step.velocities
            times.append(step.time)
        snapshots = Case(case).snapshots
        v0, v = snapshots[0].velocities, snapshots[-1].velocities
        mass, free = snapshots[0].masses[0], snapshots[0].grains
        dt = 1e-3
        np.testing.assert_allclose(times, dt * np.arange(200), atol=1e-12)
        # A force of the velocity at the start of each step: v (1 - c h / m) each; 200 roundings.
        expected = v0[free] * (1.0 - DRAG * dt / mass) ** 200
        np.testing.assert_allclose(v[free], expected, rtol=200 * 2.3e-16)
        # The first order of the step in v0 exp(-c t / m): x² h / 2 t with x = c t / m.
        x = DRAG * 0.2 / mass
        np.testing.assert_allclose(v[free], v0[free] * np.exp(-x), rtol=0.51 * x**2 / 200)
        # The theta scheme with theta = 1/2: displacements are those of the mean velocities, summed in closed form.
        q = 1.0 - DRAG * dt / mass
        way = v0[free] * dt * 0.5 * (1.0 + q) * (1.0 - q**200) / (1.0 - q)
        np.testing.assert_allclose(snapshots[-1].positions[free] - snapshots[0].positions[free], way, atol=1e-13)

    def test_torques_turn_bodies_about_fixed_axes(self) -> None:
        case = self.made(FLYING)
        for step in Loop(case, steps=10, threads=1):
            step.torques[:, 1] = 0.3
        first, last = Case(case).snapshots[0], Case(case).snapshots[-1]
        spin = 0.3 * 10e-3 / first.inertias[0, 0]
        np.testing.assert_allclose(last.spins[first.grains], [[0.0, spin, 0.0]] * 2, rtol=1e-14)
        self.assertFalse(last.spins[first.walls].any())

    def test_without_forces_the_run_is_that_without_a_loop(self) -> None:
        case, other = self.made(DROP), self.made(DROP, "other")
        seen = [step.step for step in Loop(case, threads=1)]
        self.assertEqual(seen, list(range(200)))
        run_program("cd-solve", other, "--threads=1")
        for name in ["OUTBOX/snapshot-000200.npz", "OUTBOX/steps.csv"]:
            self.assertEqual((case / name).read_bytes(), (other / name).read_bytes(), name)

    def test_a_loop_that_is_left_is_resumed_bit_for_bit(self) -> None:
        case, whole = self.made(DROP), self.made(DROP, "whole")

        def drive(loop: Loop, steps: int) -> None:
            for step in loop:
                if step.step == steps:
                    break
                step.forces[:, 0] = -0.1 * step.velocities[:, 2]

        drive(Loop(whole, threads=1), LONG)
        drive(Loop(case, threads=1), 77)
        self.assertEqual(Case(case).snapshots.steps.tolist(), [0, 50, 77])
        drive(Loop(case, resume=True, threads=1), LONG)
        for name in ["OUTBOX/snapshot-000200.npz", "OUTBOX/steps.csv"]:
            self.assertEqual((case / name).read_bytes(), (whole / name).read_bytes(), name)

    def test_steps_have_one_length(self) -> None:
        loop = Loop(self.made(FLYING), steps=20, accuracy="draft", threads=1)
        self.assertEqual([step.step for step in loop], list(range(20)))
        self.assertIn("adaptive: steps are dt in a step loop", loop.output)
        with self.assertRaisesRegex(CdError, "has been used"):
            list(loop)

    def test_failures(self) -> None:
        with self.assertRaisesRegex(CdError, "theta: 2") as raised:
            list(Loop(self.made(DROP), theta=2))
        self.assertEqual(raised.exception.exit_code, 2)
        case = self.made(DROP)
        with self.assertRaisesRegex(CdError, "standard input: step 4, body 1: .*NaN.*six finite numbers") as raised:
            for step in Loop(case, threads=1):
                step.forces[0, 2] = np.nan if step.step == 3 else 0.0
        self.assertEqual(raised.exception.exit_code, 4)
        self.assertEqual(Case(case).snapshots.steps.tolist(), [0, 3])

    def test_an_error_in_the_loop_saves_the_last_step(self) -> None:
        case = self.made(DROP)
        with self.assertRaises(ZeroDivisionError):
            for step in Loop(case, steps=LONG, output_every=LONG, threads=1):
                1 // (100 - step.step)
        # The iterator is closed when it is collected, at the latest when its frame is left.
        self.assertEqual(Case(case).snapshots.steps.tolist(), [0, 100])

    @unittest.skipIf(sys.platform == "win32", "no signals")
    def test_killed_programs_leave_whole_files(self) -> None:
        case = self.made(DROP)
        loop = Loop(case, steps=LONG, output_every=1000, threads=1)
        with self.assertRaises(CdError):
            for step in loop:
                if step.step == 2500:
                    loop._process.kill()
        self.assertEqual(Case(case).snapshots.steps.tolist(), [0, 1000, 2000])
        text = (
            "import cd_toolchain\n"
            f"for step in cd_toolchain.Loop({str(case)!r}, resume=True, steps={LONG}, output_every={LONG}):\n"
            "    print(step.step, flush=True)\n"
        )
        user = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
        assert user.stdout is not None
        while int(user.stdout.readline()) < 2100:
            pass
        os.kill(user.pid, signal.SIGKILL)
        user.wait()
        user.stdout.close()
        # The pipe is closed with the user's program: cd-solve writes its last step and ends.
        end = time.monotonic() + 30.0
        while len(Case(case).snapshots) < 4 and time.monotonic() < end:
            time.sleep(0.02)
        last = Case(case).snapshots[-1]
        self.assertGreaterEqual(last.step, 2100)
        self.assertTrue(np.isfinite(last.velocities).all())


def setUpModule() -> None:
    warnings.simplefilter("ignore", CdWarning)
