//! Laws of LMGC90 that the programs do not compute, with the reason, which an error names.

/// Reasons, and the names of the laws in TACT_BEHAV.DAT to which each applies.
const REJECTED_LAWS: &[(&str, &[&str])] = &[
    (
        "it is a law of deformable bodies, and all bodies of these programs are rigid",
        &[
            "ABP_CZM",
            "ER_MAC_CZM",
            "EXPO_CZM",
            "EXPO_CZM_P",
            "EXPO_CZM_SPRING",
            "EXPO_CZM_SPRING_P",
            "GAP_SGR_CLB_noslds",
            "GAP_SGR_CLB_nosldt",
            "GAP_SGR_DS_CLB",
            "GAP_SGR_STICK",
            "GAP_WET_DS_CLB",
            "GTN2_CZM",
            "GTN_CZM",
            "MAC_CZM",
            "MAC_CZM_noslds",
            "MAC_CZM_nosldt",
            "MAL_CZM",
            "MP3_CZM",
            "MP3_CZM_THER",
            "MP_CZM",
            "MSMP_CZM",
            "TH_CZM",
            "TOSI_CZM",
            "TOSI_CZM_INCRE",
            "postGAP_IQS_CZM",
            "postGAP_IQS_MAC_CZM",
            "preGAP_SGR_CLB",
        ],
    ),
    (
        "LMGC90 has it in two dimensions only, and its 3D solver stops",
        &[
            "BROKEN_DOF",
            "DEM_FIBs",
            "ELASTIC_REPELL_MAC_CZM",
            "ELASTIC_WET_NT",
            "GAP_SGR_CLB_WEAR",
            "IQS_SGR_CLB_WEAR",
            "IQS_WET_CZM",
            "KV_WET",
            "LJ_POTENTIAL",
            "MD_JKRs",
            "PERIO_DOF",
            "PLASTIC_COUPLED_DOF",
            "TANGENTIAL_COUPLED_DOF",
            "TEX_SOL",
            "TEX_SOL_UNILAT",
            "VEL_SGR_DS_CLB",
            "VISCO_ELASTIC_REPELL_WET",
            "WET_CZM",
        ],
    ),
    (
        "LMGC90's 3D solver stops at its first contact",
        &[
            "GAP_CAP_MOHR_DS_CLB",
            "GAP_MOHR_DS_CLB",
            "IQS_CAP_MOHR_DS_CLB",
            "IQS_CLB_noslds",
            "IQS_CLB_nosldt",
            "IQS_MAP",
            "IQS_STICK",
        ],
    ),
    (
        "wires that break, rods that are damaged and rigid wires are not among the models of cd-solve",
        &["BRITTLE_ELASTIC_WIRE", "NARD_ROD", "RIGID_WIRE"],
    ),
    (
        "cohesive zones with a damage of their own are not among the models of cd-solve",
        &[
            "IQS_ABP_CZM",
            "IQS_EXPO_CZM_P",
            "IQS_EXPO_CZM_SPRING",
            "IQS_EXPO_CZM_SPRING_P",
            "IQS_MAC_CZM_noslds",
            "IQS_MAC_CZM_nosldt",
        ],
    ),
    ("joints along the normal alone are not among the models of cd-solve", &["NORMAL_COUPLED_DOF"]),
    (
        "its internal variables or its viscosity are not among the models of cd-solve",
        &[
            "BRITTLE_COATING_CLB",
            "CRITICAL_VOIGT_CLB",
            "ELASTIC_REPELL_CLB_adapt",
            "ELASTIC_REPELL_WET_CLB",
            "IQS_BW_CLB",
            "IQS_PLAS_CLB",
            "WET_3C",
        ],
    ),
];

/// Reason why the programs do not compute with a law of LMGC90; `None` for laws that they compute with and for unknown names.
///
/// ```
/// use cd_formats::law_table::rejection_reason;
/// assert_eq!(rejection_reason("IQS_STICK"), Some("LMGC90's 3D solver stops at its first contact"));
/// assert_eq!(rejection_reason("IQS_CLB"), None);
/// ```
pub fn rejection_reason(label: &str) -> Option<&'static str> {
    REJECTED_LAWS.iter().find(|(_, names)| names.contains(&label)).map(|(reason, _)| *reason)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law_table::LAW_TABLE;

    #[test]
    fn a_law_is_computed_or_rejected_with_a_reason() {
        let names: Vec<&str> = REJECTED_LAWS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        for (k, name) in names.iter().enumerate() {
            assert!(!names[..k].contains(name), "{name} twice");
        }
        for entry in LAW_TABLE {
            assert_eq!(entry.computed, rejection_reason(entry.label).is_none(), "{}", entry.label);
        }
    }
}
