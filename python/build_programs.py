"""Build hook of the wheel: adds cd-pre, cd-solve and cd-post as scripts."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags

PROGRAMS = ("cd-pre", "cd-solve", "cd-post")
SUFFIX = ".exe" if os.name == "nt" else ""


class ProgramsHook(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the programs of the folder CD_BIN, or those that Cargo builds if CD_BIN is not set."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        folder = os.environ.get("CD_BIN")
        files = [Path(folder, name + SUFFIX) for name in PROGRAMS] if folder else build(self.root)
        missing = [str(file) for file in files if not file.is_file()]
        if missing:
            raise SystemExit(f"CD_BIN: {', '.join(missing)}: there is no such file; expected those of a release")
        build_data["shared_scripts"] = {str(file.resolve()): file.name for file in files}
        # The programs depend on the platform, and on no version of Python.
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{next(sys_tags()).platform}"


def build(root: str) -> list[Path]:
    """Builds the programs in release mode and returns their files."""
    command = ["cargo", "build", "--release", "--locked", "--message-format=json-render-diagnostics"]
    for name in PROGRAMS:
        command += ["--bin", name]
    # Without symbols the wheel has 7 MB instead of 23 MB.
    environment = {"CARGO_PROFILE_RELEASE_STRIP": "symbols", **os.environ}
    try:
        process = subprocess.run(command, cwd=root, env=environment, stdout=subprocess.PIPE, encoding="utf-8")
    except FileNotFoundError:
        raise SystemExit("cargo: is not on PATH; expected Rust, see https://rustup.rs") from None
    if process.returncode != 0:
        raise SystemExit(f"cargo: exit code {process.returncode}; its messages are above")
    messages = [json.loads(line) for line in process.stdout.splitlines()]
    return [Path(message["executable"]) for message in messages if message.get("executable")]
