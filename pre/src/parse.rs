//! Input files in which settings of the command line have replaced values.

use std::path::Path;

use cd_formats::compute::from_ron;
use cd_formats::error::Faults;
use cd_formats::settings::{setting_at, setting_fault};
use serde::de::DeserializeOwned;

/// Reads RON in which [`cd_formats::settings::apply_settings`] has replaced values. Errors: the faults of the text; those in
/// a replaced value name the setting.
pub fn parse_with_settings<T: DeserializeOwned>(
    file: &Path,
    text: &str,
    settings: &[String],
    object: &str,
) -> Result<T, Faults> {
    from_ron(file, text, object).map_err(|mut faults| {
        for fault in &mut faults.0 {
            let (line, column) = (fault.line.unwrap_or(1), fault.column.unwrap_or(1));
            if let Some(setting) = setting_at(settings, text, line, column) {
                *fault = setting_fault(setting, fault.found.as_str(), fault.expected.as_str());
            }
        }
        faults
    })
}
