#!/usr/bin/env python3
"""Prints the licences of all crates that are compiled into cd-pre, cd-solve and cd-post.

Usage: python3 .ci/dependency_licences.py TARGET

Reads Cargo.lock and the sources of the crates, by `cargo tree` and `cargo metadata`. Compiles nothing. A crate without a
licence file is listed with its licence only. A crate without a licence is an error. Data in a crate with a licence of its
own, which the crate does not contain, have it in .ci/licences/CRATE-LICENCE.txt.
"""

import json
import pathlib
import subprocess
import sys

PROGRAMS = ["cd-pre", "cd-solve", "cd-post"]
DATA_LICENCES = pathlib.Path(__file__).parent / "licences"
NAMES = ("license", "licence", "copying", "copyright", "notice", "unlicense")


def cargo(*words):
    return subprocess.run(["cargo", *words], check=True, stdout=subprocess.PIPE, encoding="utf-8").stdout


def main(target):
    packages = [word for program in PROGRAMS for word in ("--package", program)]
    tree = cargo("tree", "--locked", "--target", target, "--edges", "normal", "--prefix", "none", "--format", "{p}", *packages)
    used = {tuple(line.split()[:2]) for line in tree.splitlines() if line.strip()}
    metadata = json.loads(cargo("metadata", "--locked", "--format-version", "1", "--filter-platform", target))
    crates = [crate for crate in metadata["packages"] if (crate["name"], "v" + crate["version"]) in used and crate["source"]]
    print("Licences of the crates that are compiled into cd-pre, cd-solve and cd-post.")
    for crate in sorted(crates, key=lambda crate: (crate["name"], crate["version"])):
        name = f"{crate['name']} {crate['version']}"
        folder = pathlib.Path(crate["manifest_path"]).parent
        files = sorted(path for path in folder.iterdir() if path.is_file() and path.name.lower().startswith(NAMES))
        if not crate["license"] and not files:
            sys.exit(f"{name}: has no licence")
        of_data = sorted(DATA_LICENCES.glob(f"{crate['name']}-*.txt"))
        licences = [crate["license"]] + [path.stem.removeprefix(f"{crate['name']}-") for path in of_data]
        files += of_data
        print(f"\n{'=' * 100}\n{name}, {' and '.join(str(licence) for licence in licences)}, {crate['repository'] or ''}")
        for path in files:
            print(f"\n{'-' * 20} {path.name}\n")
            print(path.read_text(encoding="utf-8", errors="replace").strip())


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.stdout.reconfigure(encoding="utf-8", newline="\n")
    main(sys.argv[1])
