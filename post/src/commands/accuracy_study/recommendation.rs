//! Settings that give the wanted errors at the lowest cost.

use cd_formats::names::{number_text, short_number};

use crate::commands::accuracy_study::bias::{BiasStudy, OBSERVABLES, SettingBias};

/// Cheapest setting for an error, or the reason why there is none.
#[derive(Debug, Clone)]
pub enum Recommendation<'a> {
    /// Setting whose bias and uncertainty are below the error, and the cheapest faster one that may be with more replicates.
    Setting { best: &'a SettingBias<'a>, candidate: Option<(&'a SettingBias<'a>, u64)> },
    /// Chance hides whether a setting has the error: the setting that needs fewest replicates.
    Chance { nearest: &'a SettingBias<'a>, replicates: u64 },
    /// All settings have larger errors: the setting with the smallest.
    Bias { nearest: &'a SettingBias<'a> },
    /// No setting has a bias with an error.
    NoErrors,
}

impl<'a> Recommendation<'a> {
    /// Recommendation for an error of all of these observables.
    pub fn new(study: &'a BiasStudy<'a>, observables: &[usize], error: f64) -> Recommendation<'a> {
        let bound = |setting: &SettingBias| setting.worst(observables).map_or(f64::NAN, |(_, bias)| bias.bound());
        let mut settings: Vec<&SettingBias> = study.compared_settings().filter(|one| !bound(one).is_nan()).collect();
        settings.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let needed = |setting: &'a SettingBias<'a>| {
            let number = setting.needed_replicates(observables, error)?;
            Some((setting, number.max(setting.runs.runs.len() as u64 + 1)))
        };
        match settings.iter().position(|setting| bound(setting) <= error) {
            Some(first) => {
                let candidate = settings[..first].iter().copied().find_map(needed);
                Recommendation::Setting { best: settings[first], candidate }
            }
            None => {
                let nearest = settings.iter().copied().filter_map(needed).min_by_key(|(_, number)| *number);
                let smallest = settings.iter().copied().min_by(|a, b| bound(a).total_cmp(&bound(b)));
                match (nearest, smallest) {
                    (Some((nearest, replicates)), _) => Recommendation::Chance { nearest, replicates },
                    (None, Some(nearest)) => Recommendation::Bias { nearest },
                    (None, None) => Recommendation::NoErrors,
                }
            }
        }
    }

    /// Text for people; `compute_block`: options of a setting as its scene has them, if they can be read.
    pub fn text(
        &self,
        observables: &[usize],
        error: f64,
        compute_block: impl Fn(&SettingBias) -> Option<String>,
    ) -> String {
        let wanted = percent_text(error);
        match self {
            Recommendation::Setting { best, candidate } => {
                let mut text = format!(
                    "{wanted}: {}, {} s a run; {}",
                    best.runs.name,
                    short_number(best.seconds),
                    bias_text(best, observables)
                );
                if let Some((faster, replicates)) = candidate {
                    let gain = short_number(best.seconds / faster.seconds);
                    text += &format!(
                        "\n    {replicates} replicates are needed to judge {}, {gain} times as fast",
                        faster.runs.name
                    );
                }
                let block = compute_block(best).map_or(String::new(), |block| format!("\n    compute: {block},"));
                text + &block
            }
            Recommendation::Chance { nearest, replicates } => {
                let Some((worst, bias)) = nearest.worst(observables) else { return String::new() };
                format!(
                    "{wanted}: none: chance ± {} in {} of {} replicates; {replicates} are needed for {}",
                    percent_text(bias.estimate.standard_error),
                    OBSERVABLES[worst],
                    nearest.runs.runs.len(),
                    nearest.runs.name
                )
            }
            Recommendation::Bias { nearest } => {
                format!(
                    "{wanted}: none: the smallest error is that of {}, {}",
                    nearest.runs.name,
                    bias_text(nearest, observables)
                )
            }
            Recommendation::NoErrors => {
                format!("{wanted}: none: no setting has a bias with an error; expected two seeds or more")
            }
        }
    }
}

/// Bias of the observable with the largest bound, and the difference of one run from its reference.
fn bias_text(setting: &SettingBias, observables: &[usize]) -> String {
    let Some((worst, bias)) = setting.worst(observables) else { return String::new() };
    let largest_rms = observables.iter().map(|&k| setting.biases[k].rms).fold(0.0, f64::max);
    format!(
        "bias {} of {}, of one run {}",
        signed_text(bias.estimate.value, bias.uncertainty()),
        OBSERVABLES[worst],
        percent_text(largest_rms)
    )
}

/// Share in percent: `0.3 %`.
pub fn percent_text(share: f64) -> String {
    format!("{} %", number_text(rounded_to_two(100.0 * share)))
}

/// Bias with its error in percent: `+0.12 ± 0.05 %`; without the error if it is not known.
pub fn signed_text(value: f64, error: f64) -> String {
    if !value.is_finite() {
        return "-".into();
    }
    // Two digits of the error, or of the value without one.
    let scale = 100.0 * if error.is_finite() && error > 0.0 { error } else { value.abs() };
    let digits = if scale > 0.0 { (1.0 - scale.log10().floor()).clamp(0.0, 8.0) as usize } else { 0 };
    let error_text = if error.is_finite() { format!(" ± {:.digits$}", 100.0 * error) } else { String::new() };
    format!("{:+.digits$}{error_text} %", 100.0 * value)
}

/// Number with two significant digits.
fn rounded_to_two(x: f64) -> f64 {
    format!("{x:.1e}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::accuracy_study::bias::tests::setting_runs;

    #[test]
    fn the_fastest_setting_with_the_error_is_recommended() {
        let all = [
            setting_runs("fast", 1.0, 1.0, &[0.02, 0.02, 0.02]),
            // Mean 0.005, s = 0.005, SE = 0.0029: with chance removed 0.0041.
            setting_runs("noisy", 1.0, 2.0, &[0.0, 0.005, 0.01]),
            setting_runs("slow", 1.0, 4.0, &[0.001, 0.001, 0.001]),
            setting_runs("reference", 1.0, 9.0, &[0.0; 3]),
        ];
        let study = BiasStudy::new(&all);
        let text = |error: f64| {
            let block = |setting: &SettingBias| Some(format!("(dt: {})", setting.runs.dt));
            Recommendation::new(&study, &[0], error).text(&[0], error, block)
        };
        let first = "3 %: fast 1, 1.00 s a run; bias +2.0 ± 0.0 % of Z, of one run 2 %\n    compute: (dt: 1),";
        assert_eq!(text(0.03), first);
        assert!(text(0.01).starts_with("1 %: noisy 1, 2.00 s a run; bias +0.50 ± 0.29 % of Z, of one run 0.65 %"));
        // 0.0041 + 0.005/√n ≤ 0.007 for n ≥ 2.95: one more than there are.
        let slow = text(0.007);
        assert!(slow.starts_with("0.7 %: slow 1, 4.00 s a run;"), "{slow}");
        assert!(slow.contains("\n    4 replicates are needed to judge noisy 1, 2.00 times as fast\n"), "{slow}");
        assert!(text(0.0005).starts_with("0.05 %: none: the smallest error is that of slow 1, bias +0.10 ± 0.00 %"));
        let all = [all[1].clone(), all[3].clone()];
        let study = BiasStudy::new(&all);
        let found = Recommendation::new(&study, &[0], 0.005).text(&[0], 0.005, |_| None);
        // (0.005/(0.005 - 0.00408))² = 29.7.
        assert_eq!(found, "0.5 %: none: chance ± 0.29 % in Z of 3 replicates; 30 are needed for noisy 1");
        let single = [setting_runs("fast", 1.0, 1.0, &[0.0]), setting_runs("reference", 1.0, 9.0, &[0.0])];
        let study = BiasStudy::new(&single);
        assert!(matches!(Recommendation::new(&study, &[0], 0.01), Recommendation::NoErrors));
    }

    #[test]
    fn biases_have_the_digits_of_their_errors() {
        let texts = [(0.0123, 0.0045), (-0.2, 0.031), (0.012, f64::NAN), (0.0, 0.0), (f64::NAN, 1.0)]
            .map(|(value, error)| signed_text(value, error));
        assert_eq!(texts, ["+1.23 ± 0.45 %", "-20.0 ± 3.1 %", "+1.2 %", "+0 ± 0 %", "-"]);
        assert_eq!([0.003, 0.01, 0.12345].map(percent_text), ["0.3 %", "1 %", "12 %"]);
    }
}
