"""Small cases for the tests, made by the programs."""

from __future__ import annotations

import tempfile
import unittest
from collections.abc import Mapping
from pathlib import Path

from cd_toolchain import Variant

RADIUS, DENSITY, GRAVITY = 0.1, 2500.0, 9.81

DROP: Mapping[str, object] = {
    "gravity": (0.0, 0.0, -GRAVITY),
    "materials": [{"name": "GLASS", "density": DENSITY}],
    "laws": [{"name": "iqsc0", "kind": Variant("IQS_CLB")(friction=0.5)}],
    "contacts": [
        {"between": ("BLUEx", "BLUEx"), "law": "iqsc0"},
        {"between": ("BLUEx", "FLOOR"), "law": "iqsc0"},
    ],
    "grains": [
        {
            "material": "GLASS",
            "colour": "BLUEx",
            "sizes": Variant("Single")(RADIUS),
            "placement": Variant("List")(positions=[(0.0, 0.0, 0.11), (1.0, 0.0, 0.12)]),
        },
    ],
    "walls": [
        Variant("Plate")(
            material="GLASS",
            colour="FLOOR",
            centre=(0.0, 0.0, -0.05),
            normal=(0.0, 0.0, 1.0),
            half_lengths=(2.0, 2.0, 0.05),
        ),
    ],
    "compute": {"dt": 1e-3, "steps": 200, "output_every": 50},
}
"""Two beads that fall on a plate and come to rest."""

DROP_TEXT = """
(
    gravity: (0, 0, -9.81),
    materials: [(name: "GLASS", density: 2500)],
    laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
    contacts: [
        (between: ("BLUEx", "BLUEx"), law: "iqsc0"),
        (between: ("BLUEx", "FLOOR"), law: "iqsc0"),
    ],
    grains: [
        (
            material: "GLASS",
            colour: "BLUEx",
            sizes: Single(0.1),
            placement: List(positions: [(0, 0, 0.11), (1, 0, 0.12)]),
        ),
    ],
    walls: [
        Plate(
            material: "GLASS",
            colour: "FLOOR",
            centre: (0, 0, -0.05),
            normal: (0, 0, 1),
            half_lengths: (2, 2, 0.05),
        ),
    ],
    compute: (dt: 0.001, steps: 200, output_every: 50),
)
"""
"""The scene `DROP`, written by hand."""


class CaseTest(unittest.TestCase):
    """Test with a folder of its own."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
