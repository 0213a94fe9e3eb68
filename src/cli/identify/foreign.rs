//! Identification from a CSV file with a map of its columns.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::Context;

use super::super::view::findings;
use super::super::{Outcome, print_json, print_text};
use super::Arguments;
use crate::offline::identify::foreign::Foreign;
use crate::offline::identify::rigid::RigidAxis;
use crate::offline::report::identification::{self, AxisPage};

pub(super) fn run(arguments: &Arguments, data: &Path, columns: &Path) -> anyhow::Result<Outcome> {
    let map =
        std::fs::read_to_string(columns).with_context(|| format!("cannot read {}", columns.display()))?;
    let name = data.display().to_string();
    let foreign =
        Foreign::read(&map, opened(data)?).with_context(|| format!("{name} by {}", columns.display()))?;
    let axes = RigidAxis::identify(&foreign).with_context(|| name.clone())?;
    let found = axes.iter().map(|(axis, rigid)| (axis.clone(), rigid.findings(&name))).collect();
    if arguments.json {
        print_json(&found)?;
    } else {
        let said: String =
            axes.iter().map(|(axis, rigid)| format!("{axis}: {}\n", rigid.summary())).collect();
        print_text(&format!("{}\n{said}", findings(&found)))?;
    }
    if let Some(folder) = &arguments.report {
        let pages =
            axes.iter().map(|(axis, rigid)| (axis.clone(), AxisPage::of_rigid(axis, rigid))).collect();
        let files = identification::write(folder, &name, &found, &pages)?;
        eprintln!("report: {}", files.html.display());
    }
    Ok(Outcome::Done)
}

fn opened(data: &Path) -> anyhow::Result<Box<dyn Read>> {
    if data == Path::new("-") {
        return Ok(Box::new(std::io::stdin().lock()));
    }
    Ok(Box::new(File::open(data).with_context(|| format!("cannot read {}", data.display()))?))
}
