#!/usr/bin/env python3
"""Checks the crates of Cargo.lock by the rules of deny.toml: licences, sources, and crates in several versions.

Usage: python3 .ci/check_dependencies.py

For machines on which cargo-deny cannot be installed; it does not know advisories. Prints all faults and exits with 1 if there
are any.
"""

import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).parent.parent
REGISTRY = "registry+https://github.com/rust-lang/crates.io-index"


def is_allowed(expression, allowed):
    """Whether a licence expression, as of SPDX, can be met by the allowed licences."""
    words = re.findall(r"\(|\)|\bAND\b|\bOR\b|[A-Za-z0-9.+-]+(?: WITH [A-Za-z0-9.+-]+)?", expression.replace("/", " OR "))
    terms = [{"AND": "and", "OR": "or", "(": "(", ")": ")"}.get(word, str(word in allowed)) for word in words]
    return eval(" ".join(terms))  # only True, False, and, or and brackets


def main():
    rules = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))
    allowed = set(rules["licenses"]["allow"])
    skipped = {skip["name"] for skip in rules["bans"].get("skip", [])}
    banned = {ban["name"]: ban["reason"] for ban in rules["bans"].get("deny", [])}
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--all-features"]
    metadata = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout)
    faults, versions = [], {}
    for crate in metadata["packages"]:
        name, source = f"{crate['name']} {crate['version']}", crate["source"]
        versions.setdefault(crate["name"], []).append(crate["version"])
        if source not in (None, REGISTRY):
            faults.append(f"{name}: comes from {source}; expected crates.io")
        if source and crate["name"] in banned:
            faults.append(f"{name}: is banned: {banned[crate['name']]}")
        if not is_allowed(crate["license"] or "none", allowed):
            faults.append(f"{name}: licence {crate['license']}; allowed are {', '.join(sorted(allowed))}")
    for name, found in versions.items():
        if len(found) > 1 and name not in skipped:
            faults.append(f"{name}: in versions {' and '.join(found)}; expected one, or the name in bans.skip of deny.toml")
    print("".join(f"{fault}\n" for fault in faults), end="")
    print(f"{len(metadata['packages'])} crates, {len(faults)} faults")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
