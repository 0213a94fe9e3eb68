//! What a log says about its run before the first record: a metadata record `quadrant` with one key
//! per fact, and the machine file as attachment `machine.toml`. Both stand at the start of the file
//! and are on disk before the first cycle.
//!
//! Clock relation: `wall clock = wall_at_zero + Moment`, nanoseconds since 1970-01-01T00:00:00Z.
//!
//! Invariant: MCAP puts no checksum on metadata, so the key `crc32` covers all other keys; it is
//! verified before any of them is believed. This key and `format_version` never change their meaning.

use std::collections::BTreeMap;
use std::path::Path;

use jiff::Timestamp;
use serde_json::Value;

use crate::base::axis::AXES_MAX;
use crate::base::time::{Moment, Span};

use super::error::LogError;
use super::schema;

/// Name of the metadata record.
pub(super) const METADATA: &str = "quadrant";
/// Name of the attachment that is the machine file.
pub const MACHINE_ATTACHMENT: &str = "machine.toml";
/// Name of the extra that says of a log that it was imported, and what is not known of its run.
pub const IMPORTED: &str = "imported";
/// Before the name of a key that the caller added.
const EXTRA: &str = "extra.";
/// Before the name of a board sheet.
const SHEET: &str = "sheet.";
/// The key that covers the others.
const CHECKSUM: &str = "crc32";

/// What paced the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// As fast as the processor allows; the clock is the simulation's.
    Virtual,
    /// The wall clock.
    Realtime,
}

impl Pace {
    /// Name in the header and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Virtual => "virtual",
            Self::Realtime => "realtime",
        }
    }
}

/// The facts of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Version of the program that made the records.
    pub project_version: String,
    /// Its commit.
    pub commit: String,
    /// Name of the machine.
    pub machine_name: String,
    /// The machine file, as read.
    pub machine_text: String,
    /// The board sheets it names, by name.
    pub sheets: BTreeMap<String, String>,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// What paced it.
    pub pace: Pace,
    /// Wall clock at [`Moment::ZERO`], nanoseconds since 1970-01-01T00:00:00Z.
    pub wall_at_zero_ns: i64,
    /// Names of the axes, in order; they become field names of the schema.
    pub axes: Vec<String>,
    /// Length of a cycle.
    pub period: Span,
    /// Names of the gain sets, in order of `gain_set`.
    pub gain_sets: Vec<String>,
    /// What was ordered, by the number in `motion`.
    pub motions: BTreeMap<u32, Value>,
    /// Anything else worth keeping, by key.
    pub extra: BTreeMap<String, String>,
}

impl Header {
    /// Wall clock at `moment`, nanoseconds since 1970-01-01T00:00:00Z; 0 for anything before.
    pub fn wall_ns(&self, moment: Moment) -> u64 {
        u64::try_from(self.wall_at_zero_ns.saturating_add(moment.as_ns())).unwrap_or(0)
    }

    /// Whether a log can start with it.
    pub(super) fn check(&self) -> Result<(), LogError> {
        let refuse = |key, value: String, expected| Err(LogError::Header { key, value, expected });
        if self.axes.is_empty() || self.axes.len() > AXES_MAX {
            return refuse("axes", format!("{:?}", self.axes), "one to three names");
        }
        for (place, axis) in self.axes.iter().enumerate() {
            let is_field = axis.starts_with(|c: char| c.is_ascii_lowercase())
                && axis.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit());
            let is_taken = schema::CYCLE_FIELDS.iter().any(|field| field.name == axis);
            if !is_field || is_taken || self.axes[..place].contains(axis) {
                let expected =
                    "different names of lower-case letters and digits that are no field of a cycle";
                return refuse("axes", format!("{axis:?}"), expected);
            }
        }
        if self.period <= Span::ZERO {
            return refuse("period", format!("{} ns", self.period.as_ns()), "above 0 ns");
        }
        Ok(())
    }

    /// As the keys of the metadata record.
    pub(super) fn to_keys(&self) -> BTreeMap<String, String> {
        let motions: Value =
            self.motions.iter().map(|(number, motion)| (number.to_string(), motion.clone())).collect();
        let facts = [
            ("format_version", schema::VERSION.to_string()),
            ("project_version", self.project_version.clone()),
            ("commit", self.commit.clone()),
            ("machine", self.machine_name.clone()),
            ("seed", self.seed.to_string()),
            ("pace", self.pace.name().to_owned()),
            ("wall_at_zero_ns", self.wall_at_zero_ns.to_string()),
            ("wall_at_zero", rfc3339(self.wall_at_zero_ns)),
            ("axes", Value::from(self.axes.clone()).to_string()),
            ("period_ns", self.period.as_ns().to_string()),
            ("gain_sets", Value::from(self.gain_sets.clone()).to_string()),
            ("motions", motions.to_string()),
        ];
        let mut keys: BTreeMap<_, _> =
            facts.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        for (prefix, entries) in [(EXTRA, &self.extra), (SHEET, &self.sheets)] {
            keys.extend(entries.iter().map(|(key, value)| (format!("{prefix}{key}"), value.clone())));
        }
        keys.insert(CHECKSUM.to_owned(), checksum(&keys));
        keys
    }

    /// From the keys of the metadata record, which starts at byte `offset`, and the machine file.
    pub(super) fn from_keys(
        keys: &BTreeMap<String, String>,
        machine_text: String,
        file: &Path,
        offset: u64,
    ) -> Result<Self, LogError> {
        if keys.get(CHECKSUM) != Some(&checksum(keys)) {
            let what = format!("the header's {CHECKSUM} does not cover its keys");
            return Err(LogError::Damaged { file: file.to_owned(), offset, what });
        }
        let keys = Keys { keys, file };
        let found = keys.number("format_version")?;
        if found != schema::VERSION {
            return Err(LogError::Version { file: file.to_owned(), found, known: schema::VERSION });
        }
        let header = Self {
            project_version: keys.text("project_version")?.to_owned(),
            commit: keys.text("commit")?.to_owned(),
            machine_name: keys.text("machine")?.to_owned(),
            machine_text,
            seed: keys.number("seed")?,
            pace: keys.parse("pace", "`virtual` or `realtime`", |text| {
                [Pace::Virtual, Pace::Realtime].into_iter().find(|pace| pace.name() == text)
            })?,
            wall_at_zero_ns: keys.number("wall_at_zero_ns")?,
            axes: keys.json("axes", "a JSON array of names")?,
            period: Span::ns(keys.number("period_ns")?),
            gain_sets: keys.json("gain_sets", "a JSON array of names")?,
            motions: keys.json("motions", "a JSON object by motion number")?,
            sheets: keys.below(SHEET),
            extra: keys.below(EXTRA),
        };
        header.check()?;
        Ok(header)
    }
}

/// Keys with the file they came from, so that a refusal can name both.
struct Keys<'a> {
    keys: &'a BTreeMap<String, String>,
    file: &'a Path,
}

impl Keys<'_> {
    fn text(&self, key: &str) -> Result<&str, LogError> {
        self.parse(key, "present", Some)
    }
    fn number<T: std::str::FromStr>(&self, key: &str) -> Result<T, LogError> {
        self.parse(key, "a whole number", |text| text.parse().ok())
    }
    fn json<T: serde::de::DeserializeOwned>(&self, key: &str, expected: &'static str) -> Result<T, LogError> {
        self.parse(key, expected, |text| serde_json::from_str(text).ok())
    }
    fn parse<'s, T>(
        &'s self,
        key: &str,
        expected: &'static str,
        read: impl FnOnce(&'s str) -> Option<T>,
    ) -> Result<T, LogError> {
        let text = self.keys.get(key);
        text.and_then(|text| read(text)).ok_or_else(|| LogError::HeaderKey {
            file: self.file.to_owned(),
            key: key.to_owned(),
            found: text.map_or("missing".to_owned(), |text| format!("`{text}`")),
            expected,
        })
    }
    /// The entries whose key has a prefix, without it.
    fn below(&self, prefix: &str) -> BTreeMap<String, String> {
        let keys = self.keys.iter();
        keys.filter_map(|(key, value)| Some((key.strip_prefix(prefix)?.to_owned(), value.clone()))).collect()
    }
}

/// CRC-32 of all keys but the checksum's, each key and value ended by a zero byte.
fn checksum(keys: &BTreeMap<String, String>) -> String {
    let mut hasher = crc32fast::Hasher::new();
    for (key, value) in keys.iter().filter(|(key, _)| *key != CHECKSUM) {
        for part in [key, value] {
            hasher.update(part.as_bytes());
            hasher.update(&[0]);
        }
    }
    format!("{:08x}", hasher.finalize())
}

/// A wall clock as text, UTC, to the nanosecond (RFC 3339).
pub fn rfc3339(wall_ns: i64) -> String {
    format!("{:.9}", Timestamp::from_nanosecond(wall_ns.into()).unwrap_or(Timestamp::UNIX_EPOCH))
}

/// A wall clock for the name of a file, to the millisecond: `20261121T084500.123Z`.
pub fn file_stamp(wall_ns: i64) -> String {
    let time = Timestamp::from_nanosecond(wall_ns.into()).unwrap_or(Timestamp::UNIX_EPOCH);
    time.strftime("%Y%m%dT%H%M%S.%3fZ").to_string()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A header with something in every field.
    pub(in crate::log) fn example(axes: &[&str]) -> Header {
        Header {
            project_version: "0.1.0".to_owned(),
            commit: "b1f5fa8".to_owned(),
            machine_name: "reference".to_owned(),
            machine_text: "# a machine\n[axis.x]\n".to_owned(),
            sheets: BTreeMap::from([("board".to_owned(), "[identity]\n".to_owned())]),
            seed: u64::MAX,
            pace: Pace::Virtual,
            wall_at_zero_ns: 1_800_000_000_123_456_789,
            axes: axes.iter().map(|axis| (*axis).to_owned()).collect(),
            period: Span::us(500),
            gain_sets: vec!["standard".to_owned(), "optimal".to_owned()],
            motions: BTreeMap::from([(1, serde_json::json!({"circle": {"radius_mm": 150}}))]),
            extra: BTreeMap::from([("operator".to_owned(), "none".to_owned())]),
        }
    }

    fn read(keys: &BTreeMap<String, String>) -> Result<Header, LogError> {
        Header::from_keys(keys, "# a machine\n[axis.x]\n".to_owned(), Path::new("run.mcap"), 8)
    }

    #[test]
    fn every_fact_comes_back() {
        let header = example(&["x", "y"]);
        assert_eq!(read(&header.to_keys()).unwrap(), header);
    }

    #[test]
    fn a_changed_key_is_damage_and_a_newer_version_is_refused_with_both_numbers() {
        let mut keys = example(&["x"]).to_keys();
        keys.insert("seed".to_owned(), "7".to_owned());
        assert!(matches!(read(&keys), Err(LogError::Damaged { offset: 8, .. })));

        let mut keys = example(&["x"]).to_keys();
        keys.insert("format_version".to_owned(), (schema::VERSION + 1).to_string());
        keys.insert(CHECKSUM.to_owned(), checksum(&keys));
        let message = read(&keys).unwrap_err().to_string();
        assert_eq!(message, "run.mcap: log format version 7, this program reads version 6 only");
    }

    #[test]
    fn names_that_cannot_be_fields_are_refused() {
        for axes in [&["x", "x"][..], &["X"], &["cycle"], &["x y"], &[""], &[], &["a", "b", "c", "d"]] {
            let refusal = example(axes).check();
            assert!(matches!(refusal, Err(LogError::Header { key: "axes", .. })), "{axes:?}: {refusal:?}");
        }
        assert!(Header { period: Span::ZERO, ..example(&["x"]) }.check().is_err());
    }

    #[test]
    fn wall_clock_as_text() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00.000000000Z");
        assert_eq!(rfc3339(951_782_400_000_000_000), "2000-02-29T00:00:00.000000000Z");
        assert_eq!(rfc3339(1_800_000_000_123_456_789), "2027-01-15T08:00:00.123456789Z");
        assert_eq!(rfc3339(-1), "1969-12-31T23:59:59.999999999Z");
    }
}
