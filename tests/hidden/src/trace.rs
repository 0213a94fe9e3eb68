//! The rows of a run as CSV: `t_s`, then for each axis setpoint, position and table in mm, current in A.
//!
//! Numbers are written by hand, with fixed digits: a case has a million of them.
//! Invariant: the same rows give the same bytes.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::controller::PERIOD;
use crate::rig::{Reading, Row};

/// Digits after the point: of a time, so 0.1 us; of a place in mm, so 0.01 nm; of a current, so 1 uA.
const TIME_DIGITS: u32 = 7;
const PLACE_DIGITS: u32 = 8;
const CURRENT_DIGITS: u32 = 6;

/// Write one of so many rows of a run. `start` is the session's time at its begin, `stamps` what is added to the time of each row.
pub fn write(
    path: &Path,
    (rows, every): (&[Row], usize),
    start: f64,
    stamps: impl Fn(usize) -> f64,
    has_table: bool,
) -> io::Result<()> {
    let mut file = BufWriter::with_capacity(1 << 16, File::create(path)?);
    let mut head = String::from("t_s");
    for axis in ["x", "y"] {
        head += &format!(",{axis}.setpoint_mm,{axis}.position_mm");
        if has_table {
            head += &format!(",{axis}.table_mm");
        }
        head += &format!(",{axis}.current_a");
    }
    writeln!(file, "{head}")?;
    let mut line = Vec::with_capacity(160);
    for (number, row) in rows.iter().enumerate().step_by(every) {
        line.clear();
        put(&mut line, start + number as f64 * PERIOD + stamps(number), TIME_DIGITS);
        for Reading { setpoint, position, table, current } in row {
            for place in [Some(setpoint), Some(position), has_table.then_some(table)].into_iter().flatten() {
                line.push(b',');
                put(&mut line, place * 1e3, PLACE_DIGITS);
            }
            line.push(b',');
            put(&mut line, *current, CURRENT_DIGITS);
        }
        line.push(b'\n');
        file.write_all(&line)?;
    }
    file.flush()
}

/// A number with so many digits after the point.
fn put(line: &mut Vec<u8>, value: f64, digits: u32) {
    let scale = 10_u64.pow(digits);
    let mut rest = (value.abs() * scale as f64).round() as u64;
    if value < 0.0 && rest > 0 {
        line.push(b'-');
    }
    let start = line.len();
    let mut written = 0;
    while rest > 0 || written <= digits {
        if written == digits {
            line.push(b'.');
        }
        line.push(b'0' + (rest % 10) as u8);
        rest /= 10;
        written += 1;
    }
    line[start..].reverse();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_they_are() {
        for (value, text) in [
            (0.0, "0.000"),
            (-0.0001, "0.000"),
            (1.5, "1.500"),
            (-12.3456, "-12.346"),
            (0.001, "0.001"),
            (100.0, "100.000"),
        ] {
            let mut line = Vec::new();
            put(&mut line, value, 3);
            assert_eq!(String::from_utf8_lossy(&line), text);
        }
    }
}
