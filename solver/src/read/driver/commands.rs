//! Commands of LMGC90's module `chipy` and their counterparts.

/// Row of the table of commands.
pub struct ChipyCommand {
    /// Names; a `*` stands for any characters, a `?` for one.
    pub names: &'static [&'static str],
    pub meaning: CommandMeaning,
    /// Option or file that has the same purpose, the reason why there is none, or the expected alternative.
    pub counterpart: &'static str,
}

/// Effect of a command in a script.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandMeaning {
    /// Sets options from its arguments, or requires what the run must have.
    Sets(DriverSetting),
    /// Part of every run.
    Implied,
    /// Has no counterpart, and needs none.
    NotNeeded,
    /// Changes the mechanics in a way that is not supported.
    Rejected,
}

/// Settings that a command makes, or requirements that it states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriverSetting {
    TimeStep,
    Theta,
    Steps,
    Solver,
    SolverCheck,
    TextOutput,
    Output,
    Pictures,
    Periods,
    PeriodX,
    PeriodY,
    Gravity,
    Dimension,
    Record,
    Detection,
    Start,
    WholeStep,
}

use CommandMeaning::{Implied, NotNeeded, Rejected, Sets};

const fn row(names: &'static [&'static str], meaning: CommandMeaning, counterpart: &'static str) -> ChipyCommand {
    ChipyCommand { names, meaning, counterpart }
}

/// All commands that are known; the first row with a name counts.
pub const COMMANDS: &[ChipyCommand] = &[
    row(&["TimeEvolution_SetTimeStep"], Sets(DriverSetting::TimeStep), "`dt`"),
    row(&["Integrator_InitTheta"], Sets(DriverSetting::Theta), "`theta`"),
    row(
        &["IncrementStep", "TimeEvolution_IncrementStep"],
        Sets(DriverSetting::Steps),
        "`steps`, from the loop around it, or `end_time` for `while TimeEvolution_GetTime() < t`",
    ),
    row(
        &["ExSolver", "nlgs_3D_ExSolver"],
        Sets(DriverSetting::Solver),
        "`tol` from norm and tolerance, `check_every` and `max_sweeps` from both numbers of iterations",
    ),
    row(&["nlgs_3D_SetCheckType"], Sets(DriverSetting::SolverCheck), "`tol`"),
    row(
        &["WriteOut", "WriteOutDof", "WriteOutVlocRloc", "TimeEvolution_WriteOutDof", "TimeEvolution_WriteOutVlocRloc"],
        Sets(DriverSetting::TextOutput),
        "`output_every` and `text`",
    ),
    row(&["WriteHDF5"], Sets(DriverSetting::Output), "`output_every`: results are snapshots, see `cd-post`"),
    row(
        &["WriteDisplayFiles", "overall_WriteOutDisplayFile"],
        Sets(DriverSetting::Pictures),
        "`output_every`, unless `WriteOut` sets it: cd-post makes pictures of snapshots",
    ),
    row(&["SetPeriodicCondition"], Sets(DriverSetting::Periods), "`xperiode` and `yperiode`"),
    row(&["*_SetXPeriodicCondition"], Sets(DriverSetting::PeriodX), "`xperiode`"),
    row(&["*_SetYPeriodicCondition"], Sets(DriverSetting::PeriodY), "`yperiode`"),
    row(&["bulk_behav_SetGravity"], Sets(DriverSetting::Gravity), "replaces the gravity of BULK_BEHAV.DAT"),
    row(&["SetDimension", "overall_DIME"], Sets(DriverSetting::Dimension), "3 is expected"),
    row(
        &["ReadIni", "ReadIniDof", "ReadIniVlocRloc", "*_ReadIniDof", "*_ReadIniVlocRloc"],
        Sets(DriverSetting::Record),
        "record 0, the files of DATBOX, is expected",
    ),
    row(
        &["SelectProxTactors", "*SelectProxTactors"],
        Sets(DriverSetting::Detection),
        "part of a step, whatever the number of steps between two searches",
    ),
    row(
        &["computation.initialize"],
        Sets(DriverSetting::Start),
        "`dt` and `theta`; 3 dimensions and no restart are expected",
    ),
    row(
        &["computation.one_step"],
        Sets(DriverSetting::WholeStep),
        "as `IncrementStep`, `ExSolver` and `WriteOut` with the same arguments",
    ),
    row(&["computation.*_non_linear"], Rejected, "expected `computation.one_step`: bodies are rigid"),
    row(
        &["io_hdf5_read"],
        Rejected,
        "expected a start from DATBOX: write DOF.OUT and Vloc_Rloc.OUT with LMGC90 and copy them to DOF.INI and Vloc_Rloc.INI",
    ),
    row(
        &["RBDY3_PutBodyVector", "RBDY3_PutAllBodyVector"],
        Rejected,
        "expected forces (`Fext_`) by a step loop, see docs/reference/lmgc90.md, positions in BODIES.DAT, velocities in DOF.INI",
    ),
    row(&["RBDY3_SetVlocyDrivenDof"], Rejected, "expected the velocity as a function of time in DRV_DOF.DAT"),
    row(
        &["RBDY3_SetInvisible*", "RBDY3_SetVisible*", "RBDY3_RenumVisibleBodies"],
        Rejected,
        "expected a DATBOX without the bodies that are invisible",
    ),
    row(&["FatalDamping", "RBDY3_FatalDamping"], Rejected, "expected the option `quench`, or events `SetQuench`"),
    row(&["RBDY3_AvoidBodyRotation"], Rejected, "expected the components 4 to 6 imposed in DRV_DOF.DAT"),
    row(
        &["RBDY3_*ProgressiveActivation", "RBDY3_SetSourcePoint*", "RBDY3_TriaxialLoading", "TriaxialLoading"],
        Rejected,
        "expected a start with all bodies, and loads in DRV_DOF.DAT",
    ),
    row(
        &["Integrator_Init*", "Integrator_SetContactDetectionConfiguration", "NewtonRaphson_*"],
        Rejected,
        "expected `Integrator_InitTheta`: contacts are detected at x + (1-θ) h v, and steps have one length",
    ),
    row(&["TimeEvolution_SetInitial*"], Rejected, "expected step and time in DOF.INI"),
    row(&["*SmoothForceComputation"], Rejected, "expected `ExSolver`: forces of contacts are impulses over a step"),
    row(&["nlgs_3D_UseRegularization"], Rejected, "expected rigid contacts, or a law with a stiffness"),
    row(
        &["tact_behav_Set*", "tact_behav_set*", "tact_behav_init*", "bulk_behav_SetDensity", "SetContactRadius"],
        Rejected,
        "expected the values in TACT_BEHAV.DAT and BULK_BEHAV.DAT",
    ),
    row(&["POLYR_ModifyRadius", "PTPT3_Load*"], Rejected, "expected shapes and laws in the files of DATBOX"),
    row(
        &["PTPT3_UseCurrent*", "PTPT3_SetExplicit*"],
        Rejected,
        "expected wires and rods whose length at rest is the distance in BODIES.DAT",
    ),
    row(
        &["SetDomainBoundary", "RBDY3_Set?m*Boundary"],
        NotNeeded,
        "bodies beyond a boundary of the domain are not removed",
    ),
    row(
        &["RBDY3_Set*", "RBDY3_Put*", "RBDY3_computeDrvVlocy"],
        Rejected,
        "expected the values in BODIES.DAT, DOF.INI and DRV_DOF.DAT",
    ),
    row(
        &[
            "PRPRx_Use*",
            "PRPRx_Set*",
            "PRPRx_LowSize*",
            "PRPRx_Cundall*",
            "PRPRx_With*",
            "PRPRx_Force*",
            "PRPRx_Verbose*",
        ],
        NotNeeded,
        "one exact detection for convex bodies, without settings",
    ),
    row(&["PRPRx_ShrinkPolyrFaces"], NotNeeded, "points of contact are the corners of the shared face"),
    row(
        &["POLYR_*Angle", "POLYR_Skip*", "POLYR_Set*", "SetNumberInteractionByContact", "*_SetNumberInterByContact"],
        NotNeeded,
        "faces and neighbours are found without settings",
    ),
    row(
        &["nlgs_3D_*", "cpg_3D_*", "Siconos*", "nlgs_SetWithQuickScramble"],
        NotNeeded,
        "the algorithm is that of `solver`",
    ),
    row(&["RBDY3_NewRotationScheme"], NotNeeded, "the rotation of a step is exact"),
    row(&["InitHDF5"], NotNeeded, "results are snapshots and, with `text`, the text files"),
    row(&["overall_SetWorkingDirectory"], NotNeeded, "the folder is the argument `DIR`"),
    row(
        &[
            "mp_solver*",
            "ReadMp*",
            "*_LoadMp*",
            "ReadIniMp*",
            "mecaMAILx_*",
            "therMAILx_*",
            "poroMAILx_*",
            "AS*_*",
            "CS*_*",
        ],
        NotNeeded,
        "bodies are rigid, without heat and electricity",
    ),
    row(
        &[
            "Compute*",
            "*_Compute*",
            "Assemble*",
            "Update*",
            "*_Update*",
            "RBDY3_IncrementStep",
            "overall_InitEntityList",
        ],
        Implied,
        "part of a step",
    ),
    row(&["Recup*", "*Recup*", "*ecupRloc*", "StockRloc", "*tockRloc"], Implied, "part of a step"),
    row(
        &["ReadDatbox", "Read*", "*_Read*", "Load*", "*_Load*", "*_KeepIniDofOrder", "*_SkipInvisible"],
        Implied,
        "cd-solve reads DATBOX",
    ),
    row(
        &["WriteLast*", "Write*", "*_Write*", "*_CleanWriteOutFlags", "AddDof2InBodies", "*_CleanOut*"],
        Implied,
        "cd-solve writes the last snapshot in any case; DOF.LAST and Vloc_Rloc.LAST need `--text`, or a `WriteOut*` in the script",
    ),
    row(
        &[
            "OpenDisplayFiles",
            "OpenPostproFiles",
            "Open*",
            "Close*",
            "*_Close*",
            "postpro_*",
            "post3D_*",
            "display_3D_*",
            "Init*ToVTK",
            "startCollection",
            "stopCollection",
            "addRegistersToDisplay",
        ],
        Implied,
        "cd-post makes pictures and tables",
    ),
    row(
        &["*_Get*", "*_get*", "get*", "*_Is*", "Display*", "*_Display*", "register*", "*_SetDisplayRadius"],
        Implied,
        "reads values only",
    ),
    row(&["DDM_*"], NotNeeded, "threads share the work, without an effect on results"),
    row(
        &[
            "Initialize",
            "Finalize",
            "*_Initialize",
            "*_Finalize",
            "computation.finalize",
            "check*",
            "utilities_*",
            "logMes",
            "timer_*",
            "*CleanMemory",
        ],
        Implied,
        "no meaning here",
    ),
];

/// Length of a name beyond which it is no command; LMGC90's are shorter than 60.
const MAX_NAME_BYTES: usize = 100;

/// Command with this name.
pub fn find_command(name: &str) -> Option<&'static ChipyCommand> {
    COMMANDS
        .iter()
        .filter(|_| name.len() <= MAX_NAME_BYTES)
        .find(|command| command.names.iter().any(|pattern| matches(pattern, name)))
}

/// Whether a name has the form of a pattern, in which `*` stands for any characters and `?` for one.
fn matches(pattern: &str, name: &str) -> bool {
    let (mut pattern, mut name) = (pattern.chars(), name.chars());
    // Pattern after the last `*`, and the name after the characters that the `*` stands for.
    let mut retry = None;
    loop {
        let (expected, mut rest) = (pattern.clone().next(), name.clone());
        match (expected, rest.next()) {
            (None, None) => return true,
            (Some('*'), _) => {
                pattern.next();
                retry = Some((pattern.clone(), name.clone()));
                continue;
            }
            (Some(a), Some(b)) if a == '?' || a == b => {
                pattern.next();
                name = rest;
                continue;
            }
            _ => {}
        }
        // The last `*` stands for one more character; more for an earlier one would leave less of the name to the rest.
        let Some((after_star, longer)) = &mut retry else { return false };
        if longer.next().is_none() {
            return false;
        }
        (pattern, name) = (after_star.clone(), longer.clone());
    }
}

/// Rows of the table in docs/reference/lmgc90.md.
pub fn table_rows() -> Vec<String> {
    let row = |command: &ChipyCommand| {
        let names: Vec<String> = command.names.iter().map(|name| format!("`{name}`")).collect();
        let effect = match command.meaning {
            Sets(_) => "taken",
            Implied => "implied",
            NotNeeded => "none",
            Rejected => "rejected",
        };
        format!("| {} | {effect} | {} |", names.join(", "), command.counterpart)
    };
    COMMANDS.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_by_their_form() {
        for (name, meaning) in [
            ("TimeEvolution_SetTimeStep", Sets(DriverSetting::TimeStep)),
            ("TimeEvolution_ReadIniDof", Sets(DriverSetting::Record)),
            ("SPSPx_SetXPeriodicCondition", Sets(DriverSetting::PeriodX)),
            ("RBDY3_SetXminBoundary", NotNeeded),
            ("RBDY3_SetSourcePointWithIni", Rejected),
            ("RBDY3_PutBodyVector", Rejected),
            ("Integrator_InitGear", Rejected),
            ("PRPRx_UseCpCundallDetection", NotNeeded),
            ("POLYR_TopologyAngle", NotNeeded),
            ("nlgs_3D_DiagonalResolution", NotNeeded),
            ("RBDY3_ComputeFreeVelocity", Implied),
            ("RBDY3_GetBodyVector", Implied),
            ("inter_handler_3D_stockRloc", Implied),
            ("PRPRx_SelectProxTactors", Sets(DriverSetting::Detection)),
            ("RBDY3_WriteLastDof", Implied),
            ("overall_CleanWriteOutFlags", Implied),
        ] {
            assert_eq!(find_command(name).map(|command| command.meaning), Some(meaning), "{name}");
        }
        assert!(find_command("RBDY3_Fly").is_none() && find_command("").is_none());
        assert!(matches("a*c", "abc") && matches("a*c", "ac") && !matches("a*c", "acb") && matches("*", ""));
        assert!(
            matches("*ab?d", "abcdabxd") && matches("a?*", "ab") && !matches("a?*", "a") && matches("*a*b", "cacab")
        );
        assert!(!matches("ab", "abc") && !matches("abc", "ab") && matches("**", "a"));
    }
}
