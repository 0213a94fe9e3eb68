//! Board sheets: `firmware-config/NAME.toml`, each value with its object, unit and number.
//!
//! Invariant: object and unit in the file are those of the protocol, so a sheet cannot mean another
//! value than the board does.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

use super::reader::{Notes, Section, parse};
use crate::rt::drive::sheet::Sheet;
use crate::rt::wire::parameter::Object;

/// Sheets that need no file, by name.
const EMBEDDED: [(&str, &str); 1] =
    [("encoder-board", include_str!("../../firmware-config/encoder-board.toml"))];

/// Section of the sheet in which each object stands.
const LAYOUT: [(&str, &[Object]); 4] = [
    ("identity", &[Object::Vendor, Object::Product, Object::Revision]),
    ("protocol", &[Object::HeartbeatPeriod, Object::Watchdog, Object::CommandApplies]),
    ("encoders", &[Object::MotorCountsPerRev, Object::TableCountsPerMm]),
    ("current", &[Object::PeakCurrent, Object::RatedCurrent]),
];

/// Where sheets are looked for, and the texts of those that were taken.
#[derive(Debug)]
pub(super) struct Shelf<'a> {
    /// Of a log: they go before all others.
    given: &'a BTreeMap<String, String>,
    /// Of the machine file.
    folder: Option<&'a Path>,
    taken: RefCell<BTreeMap<String, String>>,
}

impl<'a> Shelf<'a> {
    pub(super) fn new(given: &'a BTreeMap<String, String>, folder: Option<&'a Path>) -> Self {
        Self { given, folder, taken: RefCell::default() }
    }

    /// The sheet of a name: a given one, `NAME.toml` in the folder, or the embedded one.
    pub(super) fn find(&self, name: &str) -> Result<Sheet, String> {
        let (file, text) = self.text(name)?;
        let sheet = read(&file, &text)?;
        self.taken.borrow_mut().insert(name.to_owned(), text);
        Ok(sheet)
    }

    fn text(&self, name: &str) -> Result<(String, String), String> {
        if let Some(text) = self.given.get(name) {
            return Ok((name.to_owned(), text.clone()));
        }
        let beside = self.folder.map(|folder| folder.join(format!("{name}.toml")));
        if let Some(path) = beside.filter(|path| path.exists()) {
            let file = path.display().to_string();
            return std::fs::read_to_string(&path)
                .map_err(|cause| format!("{file}: {cause}"))
                .map(|text| (file, text));
        }
        match EMBEDDED.into_iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Ok((name.to_owned(), text.to_owned())),
            None => {
                Err(format!("no {name}.toml beside the machine file, and embedded is only encoder-board"))
            }
        }
    }

    /// The texts that were taken, by name.
    pub(super) fn taken(self) -> BTreeMap<String, String> {
        self.taken.into_inner()
    }
}

/// What stands in for a sheet that could not be read.
pub(super) fn placeholder() -> Sheet {
    Sheet {
        vendor: 0,
        product: 0,
        revision: 0,
        heartbeat_period_ms: 100,
        watchdog_us: 5_000,
        command_applies: crate::rt::drive::sheet::CommandApplies::OnReceipt,
        motor_counts_per_rev: 1 << 20,
        table_counts_per_mm: 0,
        peak_current_ma: 1,
        rated_current_ma: 1,
    }
}

fn read(file: &str, text: &str) -> Result<Sheet, String> {
    let table = parse(file, text).map_err(|problems| problems.in_one_line())?;
    let notes = Notes::default();
    let root = Section::root(&table, &notes);
    let mut values = Vec::new();
    for (title, objects) in LAYOUT {
        let section = root.section(title);
        for object in objects {
            values.push((*object, entry(&section, *object)));
        }
        section.close();
    }
    root.close();
    notes.into_result(file, text, ()).map_err(|problems| problems.in_one_line())?;
    let value_of = |wanted: Object| values.iter().find(|(object, _)| *object == wanted).map_or(0, |v| v.1);
    Sheet::from_values(value_of).map_err(|cause| format!("{file}: {cause}"))
}

fn entry(section: &Section<'_>, object: Object) -> u32 {
    let entry = section.section(object.key());
    let (address, unit) = (object.address().to_string(), object.unit());
    if entry.text("object") != address {
        entry.conflict("object", &[], "is another object", format!("{} is object {address}", object.key()));
    }
    if entry.text("unit") != unit {
        entry.conflict("unit", &[], "is another unit", format!("{} counts in \"{unit}\"", object.key()));
    }
    let value = entry.whole("value", 0..=i64::from(u32::MAX), unit);
    entry.close();
    value as u32
}
