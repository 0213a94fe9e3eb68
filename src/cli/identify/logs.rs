//! Identification from logs of the machine itself, and the way of what was found into its machine file.

use super::super::view::findings;
use super::super::{Outcome, print_json, print_text};
use super::Arguments;
use crate::offline::identify::Findings;
use crate::offline::identify::logged::Settings;
use crate::offline::identify::logs::Logs;
use crate::offline::identify::write_back::Target;
use crate::offline::report::identification::{self, AxisPage};

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let logs = Logs::open(&arguments.log)?;
    for warning in &logs.warnings {
        eprintln!("warning: {warning}");
    }
    // A file that cannot take anything is refused before the work.
    let target = arguments.write.as_deref().map(|file| Target::open(file, &logs)).transpose()?;
    let settings =
        Settings { torque_constant_tolerance_percent: arguments.torque_constant_tolerance_percent };
    let axes = logs.identify(settings)?;
    let found: Findings = axes.iter().map(|(name, axis)| (name.clone(), axis.findings.clone())).collect();
    if arguments.json {
        print_json(&found)?;
    } else {
        let said: String = axes.iter().map(|(name, axis)| format!("{name}: {}\n", axis.summary)).collect();
        print_text(&format!("{}\n{said}", findings(&found)))?;
    }
    if let Some(folder) = &arguments.report {
        let pages = axes.iter().map(|(name, axis)| (name.clone(), AxisPage::of_logged(name, axis))).collect();
        let files = identification::write(folder, &logs.names(), &found, &pages)?;
        eprintln!("report: {}", files.html.display());
    }
    if let Some(target) = target {
        let change = target.with(&axes)?;
        eprint!("{}", change.difference());
        change.write()?;
        eprintln!("the machine file is written");
    }
    Ok(Outcome::Done)
}
