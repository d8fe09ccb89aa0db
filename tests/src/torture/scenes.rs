//! Small scenes that write files of all kinds.

/// Scene that is run under torture.
#[derive(Debug, Clone, Copy)]
pub struct TortureScene {
    /// Name in reports.
    pub name: &'static str,
    /// Text of scene.ron.
    pub text: &'static str,
    /// Text of POSTPRO.DAT; empty for none.
    pub commands: &'static str,
    /// Flags of cd-solve.
    pub flags: &'static [&'static str],
}

/// Two chains of bonded spheres that fall on a plate, an event, probes, text files, rows requested as in LMGC90.
const BONDED: TortureScene = TortureScene {
    name: "bonded",
    text: r#"(
    seed: 3,
    gravity: (0.0, 0.0, -9.81),
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [
        (
            name: "bond0",
            kind: IQS_MOHR_DS_CLB(
                normal_cohesion: 4.0e5, tangential_cohesion: 2.0e5, dynamic_friction: 0.5, static_friction: 0.5,
            ),
        ),
        (name: "iqs00", kind: IQS_CLB(friction: 0.5)),
    ],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "bond0"), (between: ("BLUEx", "FLOOR"), law: "iqs00")],
    grains: [(
        material: "ROCKx",
        colour: "BLUEx",
        sizes: Single(0.1),
        placement: List(positions: [
            (0.0, 0.0, 0.3), (0.16, 0.0, 0.42), (0.32, 0.0, 0.54), (0.48, 0.0, 0.66), (0.64, 0.0, 0.78),
            (0.4, 0.3, 0.5), (0.4, 0.42, 0.66), (0.4, 0.54, 0.82), (0.4, 0.66, 0.98), (0.4, 0.78, 1.14),
        ]),
    )],
    walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0.0, 0.0, -0.1), half_lengths: (3.0, 3.0, 0.1))],
    compute: (
        dt: 2.0e-3,
        steps: 200,
        output_every: 20,
        text: true,
        events: [
            (time: 0.1, action: AddSpin((0.0, 0.0, 0.5))),
            (time: 0.2, action: Bond),
            (time: 0.3, action: Shake(speed: 0.2)),
        ],
        probes: [
            (name: "floor", every: 5, quantity: Force(on: Colour("FLOOR"))),
            (name: "grains", quantity: Energy(of: Free)),
        ],
    ),
)"#,
    commands: "BODY TRACKING\nSTEP 3\n      2\n      1\n      5\nSOLVER INFORMATIONS\nSTEP 1\nKINETIC ENERGY\nSTEP 2\nEND\n",
    flags: &[],
};

/// Polyhedra that fall on a plate, snapshots in parts.
const ROCKS: TortureScene = TortureScene {
    name: "rocks",
    text: r#"(
    seed: 4,
    gravity: (0.0, 0.0, -9.81),
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "rst00", kind: RST_CLB(normal_restitution: 0.3, tangential_restitution: 0.0, friction: 0.4))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "rst00"), (between: ("BLUEx", "FLOOR"), law: "rst00")],
    grains: [(
        material: "ROCKx",
        colour: "BLUEx",
        number: 10,
        solid_fraction: 0.1,
        shape: Random(vertices: (8, 14), ratios: (1.0, 0.85, 0.7), angularity: 0.5),
        sizes: Uniform(min: 0.2, max: 0.3),
        placement: RandomSequential(envelope: Ball()),
        centre: (0.0, 0.0, 1.4),
    )],
    walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0.0, 0.0, -0.2), half_lengths: (4.0, 4.0, 0.2))],
    compute: (dt: 5.0e-3, steps: 160, output_every: 16),
)"#,
    commands: "",
    flags: &["--part-bodies", "4"],
};

/// Cloud of spheres under its own gravity, steps of different lengths, rows of several steps.
const CLOUD: TortureScene = TortureScene {
    name: "cloud",
    text: r#"(
    seed: 5,
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
    grains: [(
        material: "ROCKx",
        colour: "BLUEx",
        number: 30,
        solid_fraction: 0.2,
        sizes: Uniform(min: 8.0, max: 12.0),
        placement: JitteredLattice(envelope: Ball()),
    )],
    compute: (
        dt: 4.0,
        steps: 600,
        output_every: 40,
        log_every: 7,
        self_gravity: true,
        adaptive: (max_multiple: 8),
    ),
)"#,
    commands: "",
    flags: &[],
};

/// All scenes.
pub const SCENES: [TortureScene; 3] = [BONDED, ROCKS, CLOUD];
