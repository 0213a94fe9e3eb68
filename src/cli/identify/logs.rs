//! Identification from logs of the machine itself, and the way of what was found into its machine file.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::super::view::{findings, loop_margins};
use super::super::{Outcome, print_json, print_text};
use super::Arguments;
use crate::offline::identify::axis::{self, IdentifiedAxis};
use crate::offline::identify::frequency::AxisResponse;
use crate::offline::identify::logged::Settings;
use crate::offline::identify::logs::Logs;
use crate::offline::identify::write_back::Target;
use crate::offline::report;
use crate::offline::report::identification::{self, AxisPage};

pub(super) fn run(arguments: &Arguments, paths: &[PathBuf]) -> anyhow::Result<Outcome> {
    let logs = Logs::open(paths)?;
    for warning in &logs.warnings {
        eprintln!("warning: {warning}");
    }
    // A file that cannot take anything is refused before the work.
    let target = arguments.write.as_deref().map(|file| Target::open(file, &logs)).transpose()?;
    let torque_constant_tolerance_percent = arguments.forces.torque_constant_tolerance_percent;
    let settings = Settings { torque_constant_tolerance_percent };
    let axes = logs.identify_all(settings)?;
    let found = axis::findings(&axes);
    let responses: BTreeMap<String, AxisResponse> =
        axes.iter().filter_map(|axis| Some((axis.name.clone(), axis.response.clone()?))).collect();
    if arguments.json {
        print_json(&found)?;
    } else {
        let said: String =
            axes.iter().map(|axis| format!("{}: {}\n", axis.name, axis.logged.summary)).collect();
        let margins = if responses.is_empty() { String::new() } else { loop_margins(&responses) + "\n\n" };
        print_text(&format!("{margins}{}\n{said}", findings(&found)))?;
    }
    if let Some(folder) = &arguments.report {
        let page = |axis: &IdentifiedAxis| {
            (axis.name.clone(), AxisPage::of_logged(&axis.name, &axis.logged, axis.response.as_ref()))
        };
        let pages = axes.iter().map(page).collect();
        let files = identification::write(folder, &logs.names(), &found, &pages)?;
        report::frequency::write(folder, &responses)?;
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
