use super::*;

/// Every computed law with distinct values: 1/64, 2/64 ...
fn examples() -> impl Iterator<Item = (&'static LawEntry, LawModel, Vec<f64>)> {
    LAW_TABLE.iter().filter(|entry| entry.computed).map(|entry| {
        let values: Vec<f64> = (1..).take(entry.parameters().count()).map(|k| f64::from(k) / 64.0).collect();
        (entry, LawModel::from_values(entry.label, &values).unwrap(), values)
    })
}

#[test]
fn names_are_unique_and_fit_the_file() {
    for (k, entry) in LAW_TABLE.iter().enumerate() {
        assert!(LAW_TABLE[..k].iter().all(|known| known.label != entry.label), "{}", entry.label);
        assert!(entry.label.len() <= 30 && entry.lines.iter().all(|line| (1..=2).contains(&line.len())));
        assert!(entry.parameters().all(|parameter| parameter.label().len() <= 4));
        let mut names: Vec<&str> = entry.parameters().map(LawParameter::name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), entry.parameters().count(), "{}", entry.label);
        assert_eq!(entry.computed, !entry.description.is_empty());
    }
}

#[test]
fn values_and_fields_are_in_the_order_of_the_file() {
    for (entry, model, values) in examples() {
        let used = |(parameter, value)| if parameter == LawParameter::UnusedCohesion { 0.0 } else { value };
        let expected: Vec<f64> = entry.parameters().zip(values).map(used).collect();
        assert_eq!((model.label(), model.values()), (entry.label, expected));
        // A scene names the fields as the parameters are named.
        let named = model.parameter_values().into_iter().filter(|(p, _)| *p != LawParameter::UnusedCohesion);
        let fields: Vec<String> = named.map(|(p, value)| format!("{}: {value:?}", p.name())).collect();
        let text = format!("{}({})", entry.label, fields.join(", "));
        let read: LawModel = crate::ron_file::from_ron(std::path::Path::new("scene.ron"), &text, "law").unwrap();
        assert_eq!(read, model, "{text}");
    }
}

#[test]
fn friction_is_that_of_the_named_parameters() {
    for (_, model, _) in examples() {
        let value = |wanted| model.parameter_values().into_iter().find(|(p, _)| *p == wanted).map(|(_, x)| x);
        let one = value(LawParameter::Friction);
        let FrictionPair { static_friction, dynamic_friction } = model.friction();
        let has_friction = one.is_some() || value(LawParameter::StaticFriction).is_some();
        assert_eq!(
            Some(static_friction).filter(|mu| has_friction || *mu != 0.0),
            one.or(value(LawParameter::StaticFriction))
        );
        assert_eq!(
            Some(dynamic_friction).filter(|mu| has_friction || *mu != 0.0),
            one.or(value(LawParameter::DynamicFriction))
        );
        let rolling = value(LawParameter::RollingFriction).zip(value(LawParameter::SpinningFriction));
        assert_eq!(model.rolling().map(|r| (r.rolling, r.spinning)), rolling);
    }
}

#[test]
fn a_bond_has_a_limit_of_its_own() {
    let law = LawModel::from_values("IQS_MOHR_DS_CLB", &[4.0, 2.0, 0.3, 0.4]).unwrap();
    // c_t S + (c_t/c_n) f_n, also under traction.
    let load = ContactLoad { gap: 0.0, normal_force: -1.0, area: 3.0, bonded: true, soundness: 0.0, attraction: 0.0 };
    assert_eq!(law.friction_limit(&load), 2.0 * 3.0 - 0.5);
    assert_eq!(law.friction_limit(&ContactLoad { bonded: false, normal_force: 5.0, ..load }), 0.4 * 5.0);
    let bridge = LawModel::from_values("xQS_WET_DS_CLB", &[4.0, 0.0, 0.1, 0.4, 0.5]).unwrap();
    assert_eq!(bridge.friction_limit(&ContactLoad { normal_force: 2.0, ..load }), 0.5 * 6.0);
    assert_eq!(bridge.friction_limit(&ContactLoad { normal_force: 2.0, bonded: false, ..load }), 0.5 * 2.0);
}

#[test]
fn the_area_of_a_bond_with_moments_is_a_share_of_the_smaller_ball() {
    // Radii 1/2 and 1/4 m, hence 1/R = 2 + 4; next to a plate R = R_a.
    let area = |label: &str, values: &[f64], curvatures| {
        LawModel::from_values(label, values).unwrap().bond_area(curvatures) / std::f64::consts::PI
    };
    assert_eq!(area("IQS_BEAM_DS_CLB", &[4.0, 2.0, 0.5, 0.3, 0.4], [2.0, 4.0]), 1.0 / 64.0);
    assert_eq!(area("IQS_BEAM_DS_CLB", &[4.0, 2.0, 0.5, 0.3, 0.4], [2.0, 0.0]), 1.0 / 16.0);
    assert_eq!(area("IQS_MOHR_DS_CLB", &[4.0, 2.0, 0.3, 0.4], [2.0, 2.0]), 1.0 / 16.0);
}

#[test]
fn unknown_laws_and_values_out_of_range_are_reported() {
    let error = |label: &str, values: &[f64]| LawModel::from_values(label, values).unwrap_err().to_string();
    assert_eq!(error("IQS_CBL", &[0.1]), "its kind 'IQS_CBL' is not known; did you mean IQS_CLB?");
    assert_eq!(error("RST_CLB", &[0.1]), "RST_CLB with 1 parameters; expected 3: rstn, rstt, fric");
    let start =
        "its kind IQS_STICK is not computed: LMGC90's 3D solver stops at its first contact; computed are IQS_CLB, ";
    assert!(error("IQS_STICK", &[]).starts_with(start));
    let end = ", and between PT3Dx ELASTIC_WIRE, ELASTIC_ROD, VOIGT_WIRE, VOIGT_ROD";
    assert!(
        error("IQS_STICK", &[]).ends_with(end) && error("IQS_GLUE", &[]).ends_with(end),
        "{}",
        error("IQS_GLUE", &[])
    );
    let faults = |label: &str, values: &[f64]| -> Vec<String> {
        let faults = LawModel::from_values(label, values).unwrap().parameter_faults();
        faults.iter().map(ParameterFault::to_string).collect()
    };
    assert_eq!(faults("RST_CLB", &[1.5, 0.0, 0.3]), ["normal_restitution 1.5; expected 0 to 1"]);
    assert_eq!(faults("RST_CLB", &[0.5, -0.5, 0.3]), ["tangential_restitution -0.5; expected 0 to 1"]);
    assert_eq!(faults("IQS_CLB", &[-0.1]), ["friction -0.1; expected a finite number >= 0"]);
    assert_eq!(faults("IQS_CLB", &[f64::NAN]).len() + faults("IQS_CLB", &[f64::INFINITY]).len(), 2);
    assert!(faults("IQS_CLB", &[0.0]).is_empty());
    let sliding =
        "dynamic_friction 0.5 is larger than static_friction 0.3; expected dynamic_friction <= static_friction";
    assert_eq!(faults("IQS_DS_CLB", &[0.5, 0.3]), [sliding]);
    let bond = |normal, tangential| faults("IQS_MOHR_DS_CLB", &[normal, tangential, 0.2, 0.3]);
    assert_eq!(bond(0.0, 1.0), ["tangential_cohesion 1 without normal_cohesion; expected both, or none"]);
    assert_eq!(bond(1.0, -1.0), ["tangential_cohesion -1; expected a stress >= 0 Pa"]);
    assert!(bond(0.0, 0.0).is_empty() && bond(1.0, 0.0).is_empty());
    let beam = |values: &[f64]| faults("IQS_BEAM_DS_CLB", values);
    let both = "tangential_cohesion 0 with normal_cohesion 1; expected both, or none, for bonds that carry moments";
    assert_eq!(beam(&[1.0, 0.0, 1.0, 0.2, 0.3]), [both]);
    assert_eq!(beam(&[1.0, 1.0, 0.0, 0.2, 0.3]), ["bond_radius 0; expected a finite number > 0"]);
    assert!(beam(&[0.0, 0.0, 1.0, 0.2, 0.3]).is_empty());
    assert_eq!(faults("IQS_WET_DS_CLB", &[-1.0, -9.0, -1.0, 0.1, 0.2]).len(), 2, "one is not used");
}

#[test]
fn internal_variables_are_those_of_laws_with_an_interface_or_a_reference_gap() {
    for (entry, model, _) in examples() {
        assert_eq!(has_interface(entry.label), model.interface().is_some(), "{}", entry.label);
        let has_reference_gap = model.memory().contains(&ContactMemory::ReferenceGap);
        assert_eq!(reference_gap_position(entry.label).is_some(), has_reference_gap, "{}", entry.label);
        let has_size = ["GAP_SGR_CLB", "VEL_SGR_CLB", "GAP_SGR_CLB_g0"].contains(&entry.label);
        let names_size = matches!(entry.internals, LawInternals::Size | LawInternals::SizeAndReferenceGap);
        assert_eq!(names_size, has_size, "{}", entry.label);
    }
}

#[test]
fn memory_follows_from_the_parameters() {
    use ContactMemory::*;
    let memory = |label: &str| {
        let count = law_parameters(label).count();
        LawModel::from_values(label, &vec![0.5; count]).unwrap().memory()
    };
    assert_eq!(memory("RST_CLB"), []);
    assert_eq!(memory("RST_DS_CLB"), [Sliding]);
    assert_eq!(memory("xQS_WET_DS_CLB"), [Sliding, LiquidBridge]);
    assert_eq!(memory("IQS_MOHR_DS_CLB"), [Sliding, Bond]);
    assert_eq!(memory("RST_MOHR_DS_CLB"), [Sliding, Bond]);
    assert_eq!(memory("IQS_BEAM_DS_CLB"), [Sliding, Bond, Moment]);
    assert_eq!(memory("ELASTIC_BEAM_DS_CLB"), [Sliding, Bond, Moment]);
    assert_eq!(memory("IQS_WET_DS_ROLL_CLB"), [Sliding, Moment]);
}
