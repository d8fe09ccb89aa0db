"""Runs of the programs, and snapshots read while they run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import unittest
import warnings
from unittest import mock

from cd_toolchain import Case, CdError, CdWarning, Scene, find_program, run, run_program, start
from scenes import DROP, DROP_TEXT, CaseTest

LONG = 100_000_000
"""Number of steps that no test waits for."""


class RunTest(CaseTest):
    def test_scenes_as_text_as_file_and_as_data(self) -> None:
        file = self.folder / "drop.ron"
        file.write_text(DROP_TEXT)
        contents = []
        scenes: list[Scene] = [DROP, DROP_TEXT, file, str(file)]
        for number, scene in enumerate(scenes):
            case = run(scene, self.folder / f"case-{number}", steps=50, threads=1, post=False)
            contents.append(case.snapshots[-1].path.read_bytes())
        self.assertEqual(len(set(contents)), 1)

    def test_settings_and_options(self) -> None:
        settings = {"materials.1.density": 1000.0, "grains.1.colour": "BLUEx", "compute.theta": 0.6}
        options = {"steps": 2, "output_every": 1, "tol": None, "sphere_orientation": True}
        case = run(DROP, self.folder / "case", settings=settings, post=True, **options)  # type: ignore[arg-type]
        self.assertEqual(case.snapshots.steps.tolist(), [0, 1, 2])
        self.assertEqual(case.materials[0].density, 1000.0)
        options = case.meta["options"]
        self.assertEqual((options["theta"], options["sphere_orientation"]), ("0.6", "true"))
        self.assertEqual(len(case.series()["time"]), 3)

    def test_messages_and_exit_codes_of_the_programs(self) -> None:
        with self.assertRaisesRegex(CdError, r"^cd-pre: .*scene.ron:3:14: gravity: down; expected 3 values") as raised:
            run(DROP_TEXT.replace("(0, 0, -9.81)", "down"), self.folder / "wrong")
        self.assertEqual(raised.exception.exit_code, 2)
        with self.assertRaisesRegex(CdError, "cd-solve: options: theta: 2; expected 0.5 to 1") as raised:
            run(DROP_TEXT, self.folder / "case", theta=2)
        self.assertEqual(raised.exception.exit_code, 2)
        with self.assertRaisesRegex(CdError, "--thread"):
            run(DROP_TEXT, self.folder / "other", thread=2)

    def test_warnings_of_the_programs(self) -> None:
        scene = {**DROP, "materials": [{"name": "GLASS", "density": 2.5}]}
        with self.assertWarnsRegex(CdWarning, "cd-pre: warning: .*density"):
            run(scene, self.folder / "case", steps=1, post=False)

    def test_missing_programs(self) -> None:
        with mock.patch.dict("os.environ", {"PATH": ""}), mock.patch("sysconfig.get_path", return_value="/none"):
            with self.assertRaisesRegex(CdError, "cd-pre: program: is not on PATH"):
                find_program("cd-pre")

    def test_results_are_kept_replaced_and_continued(self) -> None:
        folder = self.folder / "case"
        run(DROP, folder, steps=50)
        with self.assertRaisesRegex(CdError, "results: exist; use force=True"):
            run(DROP, folder, steps=100)
        self.assertEqual(run(None, folder, resume=True, steps=100).snapshots.steps.tolist(), [0, 50, 100])
        self.assertEqual(run(DROP, folder, force=True, steps=50).snapshots.steps.tolist(), [0, 50])
        with self.assertRaisesRegex(CdError, "resume: together with a scene or force"):
            run(DROP, folder, resume=True)
        with self.assertRaisesRegex(CdError, "settings: without a scene"):
            run(None, folder, settings={"seed": 1})

    def test_a_scene_of_the_user_is_not_overwritten(self) -> None:
        (self.folder / "scene.ron").write_text("mine")
        with self.assertRaisesRegex(CdError, "scene.ron: scene: another one is there"):
            run(DROP, self.folder)
        self.assertEqual((self.folder / "scene.ron").read_text(), "mine")


class FollowTest(CaseTest):
    def test_every_snapshot_is_followed_once(self) -> None:
        started = start(DROP, self.folder / "case", output_every=1, threads=1)
        self.assertEqual([snapshot.step for snapshot in started.follow()], list(range(201)))
        self.assertFalse(started.is_running)
        self.assertIn("cd-solve: done", started.output)
        self.assertEqual(started.wait().path, self.folder / "case")
        # Another run in the same folder has snapshots of its own.
        again = start(DROP, self.folder / "case", output_every=50, force=True)
        self.assertEqual([snapshot.step for snapshot in again.follow()], [0, 50, 100, 150, 200])
        more = start(None, self.folder / "case", resume=True, output_every=50, steps=300)
        self.assertEqual([snapshot.step for snapshot in more.follow()], [250, 300])

    def test_snapshots_appear_while_the_run_is_at_work(self) -> None:
        with start(DROP, self.folder / "case", steps=LONG, output_every=1000, threads=1) as started:
            for snapshot in started.follow(poll=0.01):
                self.assertTrue(started.is_running)
                if snapshot.step >= 3000:
                    break
        self.assertFalse(started.is_running)
        # Stopped at the end of the block: cd-solve has written its last step, and says that it was stopped.
        self.assertGreaterEqual(started.case.snapshots[-1].step, 3000)
        with self.assertRaisesRegex(CdError, "stopped after step .* --resume continues") as raised:
            started.wait()
        self.assertEqual(raised.exception.exit_code, 4)

    @unittest.skipIf(sys.platform == "win32", "no signals")
    def test_an_interruption_saves_the_last_step(self) -> None:
        folder = self.folder / "case"
        (self.folder / "drop.ron").write_text(DROP_TEXT)
        text = f"import cd_toolchain; cd_toolchain.run('drop.ron', 'case', steps={LONG}, output_every={LONG})"
        # A shell's background processes ignore SIGINT, and so would their children.
        process = subprocess.Popen(
            [sys.executable, "-c", text],
            cwd=self.folder,
            stderr=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        while not (folder / "OUTBOX/snapshot-000000.npz").exists() and process.poll() is None:
            time.sleep(0.05)
        # As Ctrl-C in a terminal: all processes of the group receive the signal.
        os.killpg(process.pid, signal.SIGINT)
        _, messages = process.communicate(timeout=30)
        self.assertIn(b"KeyboardInterrupt", messages)
        self.assertEqual(len(Case(folder).snapshots), 2)
        run(None, folder, resume=True, steps=Case(folder).snapshots[-1].step + 1)

    def test_failures_end_the_iteration(self) -> None:
        started = start(DROP, self.folder / "case", theta=2)
        with self.assertRaisesRegex(CdError, "theta: 2") as raised:
            list(started.follow())
        self.assertEqual(raised.exception.exit_code, 2)
        started = start(DROP, self.folder / "case", steps=LONG, output_every=1000)
        seen = []
        with self.assertRaisesRegex(CdError, "stopped after step"):
            for snapshot in started.follow(poll=0.01):
                seen.append(snapshot.step)
                if len(seen) == 2:
                    started.stop()
        self.assertEqual(seen[:2], [0, 1000])

    def test_a_case_that_another_process_runs(self) -> None:
        folder = self.folder / "case"
        folder.mkdir()
        (folder / "scene.ron").write_text(DROP_TEXT)
        run_program("cd-pre", folder / "scene.ron")
        steps: list[int] = []
        thread = threading.Thread(target=lambda: steps.extend(s.step for s in Case(folder).follow(poll=0.02)))
        thread.start()
        time.sleep(0.1)
        run_program("cd-solve", folder, "--threads=1", "--steps=20000", "--output-every=5000")
        thread.join(30)
        self.assertEqual(steps, [0, 5000, 10000, 15000, 20000])
        # A complete case is read at once.
        self.assertEqual(len(list(Case(folder).follow())), 5)

    def test_a_run_of_another_process_that_ends_early(self) -> None:
        started = start(DROP, self.folder / "case", steps=LONG, output_every=1000)
        seen = []
        with self.assertRaisesRegex(CdError, "no new result for 0.5 s, last snapshot that of step .*--resume"):
            for snapshot in started.case.follow(poll=0.02, silence=0.5):
                seen.append(snapshot.step)
                if len(seen) == 3:
                    started.stop()
        self.assertEqual(seen[:3], [0, 1000, 2000])
        # Nobody continues it: without a run there is nothing to wait for.
        self.assertEqual(len(list(started.case.follow(poll=0.02, silence=0.1))), len(started.case.snapshots))

    def test_a_silent_run_is_recognised_by_its_lock(self) -> None:
        started = start(DROP, self.folder / "case", steps=LONG, output_every=LONG)
        timer = threading.Timer(1.0, started.stop)
        timer.start()
        begin = time.monotonic()
        with self.assertRaises(CdError):
            list(started.case.follow(poll=0.02, silence=0.3))
        timer.join()
        self.assertGreater(time.monotonic() - begin, 1.0)


def setUpModule() -> None:
    # Stopped runs are meant; their messages are tested above.
    warnings.simplefilter("ignore", CdWarning)
