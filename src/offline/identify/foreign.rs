//! Measurements that are no log of ours: a CSV file and a map that says what its columns are.
//!
//! ```toml
//! time = { column = "t", unit = "s" }
//!
//! [axis.x]
//! setpoint = { column = "q_ref", unit = "mm" }
//! position = { column = "q", unit = "mm" }
//! force = { column = "u", unit = "N", scale = 35.15 }     # or `current`, in A
//!
//! [axis.x.controller]                                     # optional: who moved it
//! position-gain-per-s = 160.0
//! velocity-gain-n-s-per-m = 8000.0
//! force-limit-n = 350.0
//! ```
//!
//! A value is what stands in the column, times `scale` (1 if absent), in `unit`. Data with the headers of a trace,
//! `t_s` and then `x.setpoint_mm`, `x.position_mm`, `x.table_mm`, `x.current_a`, need no map.
//!
//! [`Foreign::read`] takes sound data only: rows even in time, every value finite; what is not is an error with its
//! line. [`Raw::read`] takes the columns as they stand, for whoever looks at what is wrong with them.
//! Invariant: no value is invented.

use std::collections::BTreeMap;
use std::io::Read;

use serde::Deserialize;
use thiserror::Error;

/// How far the step between two rows may be from the others, as a share.
const STEP_TOLERANCE: f64 = 0.01;

/// Why there are no columns.
#[derive(Debug, Error)]
pub enum ForeignError {
    /// The map is not one.
    #[error("the column map: {0}")]
    Map(#[from] toml::de::Error),
    /// A unit that the quantity does not have.
    #[error("{key}: unit \"{unit}\" is none of {known}")]
    Unit {
        /// Which quantity.
        key: String,
        /// What the map says.
        unit: String,
        /// Those it could be.
        known: String,
    },
    /// A scale that makes nothing of a value.
    #[error("{key}: scale {scale}, expected a finite number other than 0")]
    Scale {
        /// Which quantity.
        key: String,
        /// What the map says.
        scale: f64,
    },
    /// An axis that has both or neither.
    #[error("axis {axis}: expected `force` or `current`, and not both")]
    Effort {
        /// Which axis.
        axis: String,
    },
    /// No axis in the map.
    #[error("the column map has no axis: expected a table [axis.NAME]")]
    NoAxis,
    /// The data have no such column.
    #[error("{key}: no column \"{column}\"; the data have {available}")]
    NoColumn {
        /// Which quantity.
        key: String,
        /// Its column in the map.
        column: String,
        /// Columns there are.
        available: String,
    },
    /// The data cannot be read.
    #[error("the data: {0}")]
    Csv(#[from] csv::Error),
    /// A value that is no finite number.
    #[error("line {line}, column \"{column}\": \"{text}\" is not a finite number")]
    Value {
        /// Line in the file.
        line: u64,
        /// Name of the column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// Rows that are not even in time.
    #[error("row {row}: {step_s} s after the row before it, the others {expected_s} s (within 1 %)")]
    Uneven {
        /// Row, from 1.
        row: usize,
        /// Its distance.
        step_s: f64,
        /// That of the others.
        expected_s: f64,
    },
    /// Not enough rows.
    #[error("{rows} rows, at least 3 are needed")]
    TooShort {
        /// Rows there are.
        rows: usize,
    },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Map {
    time: Column,
    axis: BTreeMap<String, AxisMap>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AxisMap {
    setpoint: Option<Column>,
    position: Column,
    table: Option<Column>,
    force: Option<Column>,
    current: Option<Column>,
    controller: Option<Controller>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    column: String,
    unit: String,
    #[serde(default = "one")]
    scale: f64,
}

const fn one() -> f64 {
    1.0
}

/// Position P and velocity P over a measured axis, as the map tells it.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Controller {
    /// Velocity command per following error, 1/s.
    pub position_gain_per_s: f64,
    /// Force per velocity error, N s/m.
    pub velocity_gain_n_s_per_m: f64,
    /// Largest force, N.
    pub force_limit_n: f64,
}

/// What moved the axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Effort {
    /// Force on the axis, N.
    Force(Vec<f64>),
    /// Current of the motor, A.
    Current(Vec<f64>),
}

impl Effort {
    /// Its rows.
    pub fn values(&self) -> &[f64] {
        match self {
            Self::Force(values) | Self::Current(values) => values,
        }
    }
}

/// One measured axis.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignAxis {
    /// Wanted position, m, if it is known.
    pub setpoint_m: Option<Vec<f64>>,
    /// Measured position, m.
    pub position_m: Vec<f64>,
    /// Position of the table by a scale of its own, m, if there is one.
    pub table_m: Option<Vec<f64>>,
    /// What moved it.
    pub effort: Effort,
    /// Who moved it, if that is known.
    pub controller: Option<Controller>,
}

/// Measurements on an even grid of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Foreign {
    /// From row to row, s.
    pub period_s: f64,
    /// The axes by name.
    pub axes: BTreeMap<String, ForeignAxis>,
}

const TIMES: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];
const LENGTHS: [(&str, f64); 4] = [("m", 1.0), ("mm", 1e-3), ("um", 1e-6), ("nm", 1e-9)];
const FORCES: [(&str, f64); 2] = [("N", 1.0), ("kN", 1e3)];
const CURRENTS: [(&str, f64); 2] = [("A", 1.0), ("mA", 1e-3)];

impl Foreign {
    /// Read the columns that the map names.
    ///
    /// # Errors
    /// When map or data are not as described above.
    pub fn read(map: &str, data: impl Read) -> Result<Self, ForeignError> {
        let raw = Table::read(data, Value::Finite)?.columns(&Map::read(map)?)?;
        Ok(Self { period_s: even_step_s(&raw.time_s)?, axes: raw.axes })
    }
}

/// Measurements as they stand in the file: what is no finite number is NaN, and time may do anything.
#[derive(Clone, Debug, PartialEq)]
pub struct Raw {
    /// Time of each row, s.
    pub time_s: Vec<f64>,
    /// The axes by name.
    pub axes: BTreeMap<String, ForeignAxis>,
}

impl Raw {
    /// Read the columns that the map names, or, without one, those that are named like a trace's.
    ///
    /// # Errors
    /// When a column is missing or the map is none.
    pub fn read(map: Option<&str>, data: impl Read) -> Result<Self, ForeignError> {
        let table = Table::read(data, Value::Any)?;
        let map = map.map_or_else(|| Ok(Map::of_trace(&table.names)), Map::read)?;
        table.columns(&map)
    }
}

impl Map {
    fn read(text: &str) -> Result<Self, ForeignError> {
        let map: Self = toml::from_str(text)?;
        if map.axis.is_empty() { Err(ForeignError::NoAxis) } else { Ok(map) }
    }

    /// Of columns that are named as a trace names them.
    fn of_trace(names: &[String]) -> Self {
        let column = |column: String, unit: &str| Column { column, unit: unit.to_owned(), scale: one() };
        let axis = |name: &str| {
            let table = format!("{name}.table_mm");
            AxisMap {
                setpoint: Some(column(format!("{name}.setpoint_mm"), "mm")),
                position: column(format!("{name}.position_mm"), "mm"),
                table: names.contains(&table).then(|| column(table, "mm")),
                force: None,
                current: Some(column(format!("{name}.current_a"), "A")),
                controller: None,
            }
        };
        let axes = names.iter().filter_map(|name| name.split_once('.')).map(|(axis, _)| axis);
        // Without a single axis the message names the columns of the first.
        let axes: Vec<&str> =
            if names.iter().any(|name| name.contains('.')) { axes.collect() } else { vec!["x"] };
        Self {
            time: column("t_s".to_owned(), "s"),
            axis: axes.into_iter().map(|name| (name.to_owned(), axis(name))).collect(),
        }
    }
}

/// What may stand in a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Value {
    Finite,
    Any,
}

/// The data as text, with the line of each row.
struct Table {
    names: Vec<String>,
    rows: Vec<csv::StringRecord>,
    value: Value,
}

impl Table {
    fn read(data: impl Read, value: Value) -> Result<Self, ForeignError> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(data);
        let names = reader.headers()?.iter().map(str::to_owned).collect();
        let rows = reader.into_records().collect::<Result<Vec<_>, _>>()?;
        Ok(Self { names, rows, value })
    }

    fn columns(&self, map: &Map) -> Result<Raw, ForeignError> {
        let time_s = self.column("time", &map.time, &TIMES)?;
        let axes = map.axis.iter().map(|(name, axis)| Ok((name.clone(), self.axis(name, axis)?)));
        Ok(Raw { time_s, axes: axes.collect::<Result<_, ForeignError>>()? })
    }

    fn axis(&self, name: &str, map: &AxisMap) -> Result<ForeignAxis, ForeignError> {
        let key = |quantity: &str| format!("axis.{name}.{quantity}");
        let effort = match (&map.force, &map.current) {
            (Some(force), None) => Effort::Force(self.column(&key("force"), force, &FORCES)?),
            (None, Some(current)) => Effort::Current(self.column(&key("current"), current, &CURRENTS)?),
            (Some(_), Some(_)) | (None, None) => return Err(ForeignError::Effort { axis: name.to_owned() }),
        };
        let length = |quantity: &str, map: &Option<Column>| {
            map.as_ref().map(|map| self.column(&key(quantity), map, &LENGTHS)).transpose()
        };
        Ok(ForeignAxis {
            setpoint_m: length("setpoint", &map.setpoint)?,
            position_m: self.column(&key("position"), &map.position, &LENGTHS)?,
            table_m: length("table", &map.table)?,
            effort,
            controller: map.controller,
        })
    }

    fn column(&self, key: &str, map: &Column, units: &[(&str, f64)]) -> Result<Vec<f64>, ForeignError> {
        let Some((_, factor)) = units.iter().find(|(unit, _)| *unit == map.unit) else {
            let known = units.iter().map(|(unit, _)| *unit).collect::<Vec<_>>().join(", ");
            return Err(ForeignError::Unit { key: key.to_owned(), unit: map.unit.clone(), known });
        };
        if !map.scale.is_finite() || map.scale == 0.0 {
            return Err(ForeignError::Scale { key: key.to_owned(), scale: map.scale });
        }
        let Some(place) = self.names.iter().position(|name| *name == map.column) else {
            let (column, available) = (map.column.clone(), self.names.join(", "));
            return Err(ForeignError::NoColumn { key: key.to_owned(), column, available });
        };
        let unit = map.scale * factor;
        let read = |row| match (value(row, place, &map.column), self.value) {
            (Ok(value), _) => Ok(value * unit),
            (Err(_), Value::Any) => Ok(f64::NAN),
            (Err(error), Value::Finite) => Err(error),
        };
        self.rows.iter().map(read).collect()
    }
}

fn value(row: &csv::StringRecord, place: usize, column: &str) -> Result<f64, ForeignError> {
    let text = row.get(place).unwrap_or_default();
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| ForeignError::Value {
        line: row.position().map_or(0, csv::Position::line),
        column: column.to_owned(),
        text: text.to_owned(),
    })
}

fn even_step_s(time_s: &[f64]) -> Result<f64, ForeignError> {
    let rows = time_s.len();
    if rows < 3 {
        return Err(ForeignError::TooShort { rows });
    }
    let expected_s = (time_s[rows - 1] - time_s[0]) / (rows - 1) as f64;
    let is_even = |step_s: f64| expected_s > 0.0 && (step_s / expected_s - 1.0).abs() <= STEP_TOLERANCE;
    let steps = time_s.windows(2).map(|pair| pair[1] - pair[0]);
    match steps.enumerate().find(|(_, step_s)| !is_even(*step_s)) {
        Some((before, step_s)) => Err(ForeignError::Uneven { row: before + 2, step_s, expected_s }),
        None => Ok(expected_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = r#"
        time = { column = "t", unit = "ms" }
        [axis.x]
        setpoint = { column = "ref", unit = "mm" }
        position = { column = "q", unit = "um", scale = 2.0 }
        force = { column = "u", unit = "N", scale = 35.0 }
    "#;
    const DATA: &str = "t, ref, q, u, rest\n0, 1, 10, 0.5, a\n1, 2, 20, -0.5, b\n2, 3, 30, 1e0, c\n";

    fn said(map: &str, data: &str) -> String {
        Foreign::read(map, data.as_bytes()).expect_err("it is wrong").to_string()
    }

    #[test]
    fn columns_are_read_with_unit_and_scale() {
        let foreign = Foreign::read(MAP, DATA.as_bytes()).expect("it is right");
        assert_eq!(foreign.period_s, 1e-3);
        let axis = &foreign.axes["x"];
        assert_eq!(axis.setpoint_m, Some(vec![1e-3, 2e-3, 3e-3]));
        assert!((axis.position_m[2] - 60e-6).abs() < 1e-18);
        assert_eq!(axis.effort, Effort::Force(vec![17.5, -17.5, 35.0]));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place() {
        assert_eq!(
            said(&MAP.replace("\"um\"", "\"inch\""), DATA),
            "axis.x.position: unit \"inch\" is none of m, mm, um, nm"
        );
        assert_eq!(
            said(&MAP.replace("\"u\"", "\"volts\""), DATA),
            "axis.x.force: no column \"volts\"; the data have t, ref, q, u, rest"
        );
        assert_eq!(
            said(MAP, &DATA.replace("20", "NaN")),
            "line 3, column \"q\": \"NaN\" is not a finite number"
        );
        assert_eq!(
            said(MAP, &DATA.replace("2, 3", "4, 3")),
            "row 2: 0.001 s after the row before it, the others 0.002 s (within 1 %)"
        );
        assert_eq!(said(MAP, "t,ref,q,u\n0,1,1,1\n"), "1 rows, at least 3 are needed");
        assert_eq!(
            said(&MAP.replace("force", "mass"), DATA).lines().next(),
            Some("the column map: TOML parse error at line 6, column 9")
        );
        assert_eq!(
            said(&MAP.replace("force = { column = \"u\", unit = \"N\", scale = 35.0 }", ""), DATA),
            "axis x: expected `force` or `current`, and not both"
        );
        assert_eq!(
            said(&MAP.replace("35.0", "0.0"), DATA),
            "axis.x.force: scale 0, expected a finite number other than 0"
        );
        assert!(said(MAP, "t,ref,q,u\n0,1,1\n").contains("record 1"), "a row is cut off");
    }

    #[test]
    fn a_trace_needs_no_map_and_may_hold_what_is_wrong() {
        let data = "t_s,x.setpoint_mm,x.position_mm,x.current_a,y.setpoint_mm,y.position_mm,y.table_mm,y.current_a\n\
                    0,1,2,3,4,5,6,7\n0,nan,2,3,4,,6,7\n";
        let raw = Raw::read(None, data.as_bytes()).expect("a trace");
        assert_eq!(raw.time_s, [0.0, 0.0]);
        assert_eq!(raw.axes["x"].table_m, None);
        assert_eq!(raw.axes["y"].table_m, Some(vec![6e-3, 6e-3]));
        assert!(raw.axes["x"].setpoint_m.as_ref().expect("it has one")[1].is_nan());
        assert!(raw.axes["y"].position_m[1].is_nan());
        let none = Raw::read(None, "a,b\n1,2\n".as_bytes()).expect_err("no trace").to_string();
        assert_eq!(none, "time: no column \"t_s\"; the data have a, b");
    }
}
