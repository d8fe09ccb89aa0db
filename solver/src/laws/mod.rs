//! Bench: contact laws. The local solver knows one problem, û = W r̂ + b̂ with Signorini's condition
//! and Coulomb's cone on (û, r̂). A law supplies the shifts û = u + shift and r = r̂ + c n:
//!
//! | law | normal shift | tangential shift | c, N s | friction |
//! |---|---|---|---|---|
//! | IQS_CLB, inelastic quasi-shock | max(0, g/h) | 0 | 0 | mu |
//! | IQS_DS_CLB | max(0, g/h) | 0 | 0 | mu_d after sliding, else mu_s |
//! | GAP_SGR_CLB, Signorini on the gap | g/h | 0 | 0 | mu |
//! | VEL_SGR_CLB, Signorini on the velocity (g <= 0, else no contact) | 0 | 0 | 0 | mu |
//! | RST_CLB, restitution (g <= 0, else no contact) | e_n u_n⁻ | e_t u_T⁻ where u_n⁻ < 0 | 0 | mu |
//! | RST_DS_CLB | the same | the same | 0 | mu_d after sliding, else mu_s |
//! | IQS_WET_DS_CLB, cohesive force f while g <= range | max(0, g/h) | 0 | -h f | mu_d after sliding, else mu_s |
//!
//! u⁻ is the relative velocity at the step's start. Friction acts on r̂_n = r_n + h f: a cohesive
//! contact slides at mu (r_n/h + f). Names and parameters are those of LMGC90.
//!
//! Restitution holds for a contact that was parting, too: thrown back by its neighbours within the step, it may
//! close at e_n times its speed. So (v⁺ + e v⁻)/(1 + e) is the projection of v⁻ on what the contacts allow, and
//! several contacts of one e_n give no energy without friction. With friction that holds for a single contact only.
//!
//! Sources: M. Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999) 235-257; J.J. Moreau, Unilateral
//! contact and dry friction in finite freedom dynamics, CISM 302 (1988).

/// When a contact resists, along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unilateral {
    /// An open gap may close within the step; an interpenetration is kept.
    InelasticShock,
    /// The gap at the step's end is not negative: an interpenetration is pushed out within the step.
    Gap,
    /// Only once touching, and then without regard to the gap.
    Velocity,
    /// Newton's restitution.
    Restitution { normal: f64, tangential: f64 },
}

/// A constant attraction `force` (N) while the gap is at most `range` (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cohesion {
    pub force: f64,
    pub range: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    pub unilateral: Unilateral,
    pub cohesion: Option<Cohesion>,
    /// Coefficient of friction of a contact that does not slide yet.
    pub friction_static: f64,
    /// Coefficient of friction of a contact that slid in the last step.
    pub friction_dynamic: f64,
}

/// What a law adds to the standard problem of one contact in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    /// Added to u_n, m/s.
    pub normal: f64,
    /// û_T = u_T + tangential u_T⁻.
    pub tangential: f64,
    /// c = r_n - r̂_n, N s; negative for an attraction.
    pub impulse: f64,
    pub friction: f64,
}

/// The parameters that a law is read from, in the order of TACT_BEHAV.DAT.
pub const KINDS: [&str; 7] =
    ["IQS_CLB", "IQS_DS_CLB", "GAP_SGR_CLB", "VEL_SGR_CLB", "RST_CLB", "RST_DS_CLB", "IQS_WET_DS_CLB"];

impl Law {
    /// The law named `kind` in TACT_BEHAV.DAT; none when it is not one of [`KINDS`] with that number of parameters.
    pub fn new(kind: &str, parameters: &[f64]) -> Option<Law> {
        use Unilateral::*;
        let law = |unilateral, cohesion, dynamic, fixed| Law {
            unilateral,
            cohesion,
            friction_static: fixed,
            friction_dynamic: dynamic,
        };
        Some(match (kind, parameters) {
            ("IQS_CLB", &[mu]) => law(InelasticShock, None, mu, mu),
            ("IQS_DS_CLB", &[dynamic, fixed]) => law(InelasticShock, None, dynamic, fixed),
            ("GAP_SGR_CLB", &[mu]) => law(Gap, None, mu, mu),
            ("VEL_SGR_CLB", &[mu]) => law(Velocity, None, mu, mu),
            ("RST_CLB", &[normal, tangential, mu]) => law(Restitution { normal, tangential }, None, mu, mu),
            ("RST_DS_CLB", &[normal, tangential, dynamic, fixed]) => {
                law(Restitution { normal, tangential }, None, dynamic, fixed)
            }
            ("IQS_WET_DS_CLB", &[force, _tangential, range, dynamic, fixed]) => {
                law(InelasticShock, Some(Cohesion { force, range }), dynamic, fixed)
            }
            _ => return None,
        })
    }

    /// What is wrong with the parameters, if anything.
    pub fn fault(&self) -> Option<(&'static str, f64)> {
        let restitution = match self.unilateral {
            Unilateral::Restitution { normal, tangential } => {
                [("normal restitution", normal), ("tangential restitution", tangential)]
            }
            _ => [("", 0.0); 2],
        };
        let cohesion = self.cohesion.unwrap_or(Cohesion { force: 0.0, range: 0.0 });
        let least_zero = [
            ("static friction", self.friction_static),
            ("dynamic friction", self.friction_dynamic),
            ("cohesive force", cohesion.force),
            ("cohesive range", cohesion.range),
        ];
        let outside = restitution.into_iter().find(|(_, e)| !(0.0..=1.0).contains(e));
        outside.or(least_zero.into_iter().find(|(_, x)| !(*x >= 0.0 && x.is_finite())))
    }

    /// The law's shifts for a contact of this `gap` (m), in a step of length `h` (s), whose normal
    /// relative velocity at the step's start is `u_n` (m/s, > 0 parting); none when the contact
    /// does not act in this step.
    pub fn shift(&self, gap: f64, h: f64, u_n: f64, slid_before: bool) -> Option<Shift> {
        let (normal, tangential) = match self.unilateral {
            Unilateral::InelasticShock => ((gap / h).max(0.0), 0.0),
            Unilateral::Gap => (gap / h, 0.0),
            Unilateral::Velocity if gap <= 0.0 => (0.0, 0.0),
            Unilateral::Restitution { normal, tangential } if gap <= 0.0 => {
                (normal * u_n, if u_n < 0.0 { tangential } else { 0.0 })
            }
            Unilateral::Velocity | Unilateral::Restitution { .. } => return None,
        };
        let impulse = match self.cohesion {
            Some(cohesion) if gap <= cohesion.range => -h * cohesion.force,
            _ => 0.0,
        };
        let friction = if slid_before { self.friction_dynamic } else { self.friction_static };
        Some(Shift { normal, tangential, impulse, friction })
    }

    /// Greatest gap at which a contact that is not closing can still act, m.
    pub fn range(&self) -> f64 {
        self.cohesion.map_or(0.0, |cohesion| cohesion.range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifts_follow_the_table() {
        let h = 0.5;
        let shift =
            |kind, parameters: &[f64], gap, u_n, slid| Law::new(kind, parameters).unwrap().shift(gap, h, u_n, slid);
        let plain = |normal, friction| Some(Shift { normal, tangential: 0.0, impulse: 0.0, friction });
        assert_eq!(shift("IQS_CLB", &[0.4], 0.1, -1.0, false), plain(0.2, 0.4));
        assert_eq!(shift("IQS_CLB", &[0.4], -0.1, -1.0, false), plain(0.0, 0.4));
        assert_eq!(shift("IQS_DS_CLB", &[0.1, 0.4], 0.1, -1.0, true), plain(0.2, 0.1));
        assert_eq!(shift("GAP_SGR_CLB", &[0.4], -0.1, 0.0, false), plain(-0.2, 0.4));
        assert_eq!(shift("VEL_SGR_CLB", &[0.4], -0.1, 0.0, false), plain(0.0, 0.4));
        assert_eq!(shift("VEL_SGR_CLB", &[0.4], 0.1, 0.0, false), None);
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 0.1, -1.0, false), None);
        let shock = Shift { normal: -0.5, tangential: 0.25, impulse: 0.0, friction: 0.4 };
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 0.0, -1.0, false), Some(shock));
        assert_eq!(shift("RST_CLB", &[0.5, 0.25, 0.4], 0.0, 1.0, false), plain(0.5, 0.4));
        let wet = Shift { normal: 0.02, tangential: 0.0, impulse: -5.0, friction: 0.3 };
        assert_eq!(shift("IQS_WET_DS_CLB", &[10.0, 0.0, 0.01, 0.2, 0.3], 0.01, 0.0, false), Some(wet));
        assert_eq!(shift("IQS_WET_DS_CLB", &[10.0, 0.0, 0.01, 0.2, 0.3], 0.02, 0.0, false), plain(0.04, 0.3));
    }

    #[test]
    fn unknown_names_and_values_out_of_range_are_told() {
        assert_eq!(Law::new("IQS_MAP", &[0.1]), None);
        assert_eq!(Law::new("IQS_CLB", &[]), None);
        assert_eq!(Law::new("RST_CLB", &[1.5, 0.0, 0.3]).unwrap().fault(), Some(("normal restitution", 1.5)));
        assert_eq!(Law::new("IQS_CLB", &[-0.1]).unwrap().fault(), Some(("static friction", -0.1)));
        assert_eq!(Law::new("IQS_CLB", &[0.0]).unwrap().fault(), None);
    }
}
