//! What the simulated axes really did: the measure for what the controller believed and achieved.
//!
//! A simulated machine in another process tells it as text, one row for each SYNC, beside the bus and never
//! over it ([`Told`] reads it):
//!
//! ```text
//!   cycle,x position m,x motor m/s,x table m/s,x current A,y position m,...
//!   0,0,0,0,0,0,...
//! ```
//!
//! Invariant: a row that was read is the row that was written, to the bit.

use std::fmt;
use std::io::BufRead;

use crate::base::axis::{AXES_MAX, PerAxis};
use crate::base::units::{Current, Position, Velocity};

/// Rows that a machine in lock step may keep back: it hands them out at the latest with the SYNC of a cycle
/// whose number is the last of such a block.
pub const BLOCK_CYCLES: u64 = 64;

/// What an axis really does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisTruth {
    /// Where a perfect encoder has its motor.
    pub position: Position,
    /// Of the motor.
    pub motor_velocity: Velocity,
    /// Of the table.
    pub table_velocity: Velocity,
    /// What its drive gives.
    pub current: Current,
}

impl AxisTruth {
    /// Neither motor nor table moves faster than this.
    pub fn is_slower_than(&self, standstill: Velocity) -> bool {
        self.motor_velocity.abs() <= standstill && self.table_velocity.abs() <= standstill
    }

    /// No current, and as good as no motion.
    pub fn is_still(&self, standstill: Velocity) -> bool {
        self.current == Current::ZERO && self.is_slower_than(standstill)
    }
}

/// What all axes did at the SYNC of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The number in the SYNC.
    pub cycle: u32,
    /// Each axis.
    pub axes: PerAxis<AxisTruth>,
}

/// As its line, without the end.
impl fmt::Display for Row {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}", self.cycle)?;
        for axis in self.axes.as_slice() {
            // The shortest text that reads as the same number.
            for value in [
                axis.position.as_m(),
                axis.motor_velocity.as_m_per_s(),
                axis.table_velocity.as_m_per_s(),
                axis.current.as_a(),
            ] {
                write!(out, ",{value}")?;
            }
        }
        Ok(())
    }
}

/// The line above the rows of axes with these names.
pub fn heading(axes: &[String]) -> String {
    let of_axis =
        |name: &String| format!(",{name} position m,{name} motor m/s,{name} table m/s,{name} current A");
    "cycle".to_owned() + &axes.iter().map(of_axis).collect::<String>()
}

/// Why the truth is not known.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// It cannot be read.
    #[error("what the simulated axes did cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// Nothing more is told.
    #[error("the simulated machine ended before it told what its axes did in cycle {cycle}")]
    Ended {
        /// The cycle that was asked for.
        cycle: u32,
    },
    /// Something else is told.
    #[error("the simulated machine told {line:?} where what its axes did was expected")]
    Other {
        /// What came.
        line: String,
    },
    /// Of another machine.
    #[error("the simulated machine tells {told:?}, where the scenario's machine has {expected:?}")]
    OtherAxes {
        /// What it tells.
        told: String,
        /// What was expected.
        expected: String,
    },
}

/// The rows that a machine in another process tells.
#[derive(Debug)]
pub struct Told<R> {
    lines: R,
    axes: usize,
    line: String,
    /// Read, and of a cycle that is yet to be asked for.
    ahead: Option<Row>,
}

impl<R: BufRead> Told<R> {
    /// Reads the heading, which a machine tells when it is ready for a host. Waits for it.
    pub fn begin(mut lines: R, axes: &[String]) -> Result<Self, TruthError> {
        let mut line = String::new();
        lines.read_line(&mut line)?;
        if line.is_empty() {
            return Err(TruthError::Ended { cycle: 0 });
        }
        let expected = heading(axes);
        if line.trim_end() != expected {
            return Err(TruthError::OtherAxes { told: line.trim_end().to_owned(), expected });
        }
        Ok(Self { lines, axes: axes.len(), line, ahead: None })
    }

    /// What the axes did in a cycle; earlier cycles are passed over. Waits for it, or for that of a later
    /// cycle: then `None`, because the machine has not heard the SYNC.
    pub fn of_cycle(&mut self, cycle: u32) -> Result<Option<PerAxis<AxisTruth>>, TruthError> {
        loop {
            let row = match self.ahead.take() {
                Some(row) => row,
                None => self.next_row()?.ok_or(TruthError::Ended { cycle })?,
            };
            // The numbers of SYNCs go around.
            match cycle.wrapping_sub(row.cycle) as i32 {
                0 => return Ok(Some(row.axes)),
                1.. => {}
                _ => {
                    self.ahead = Some(row);
                    return Ok(None);
                }
            }
        }
    }

    /// Hears the machine out: one that cannot tell what it knows has failed.
    pub fn hear_out(mut self) -> Result<(), TruthError> {
        std::io::copy(&mut self.lines, &mut std::io::sink())?;
        Ok(())
    }

    /// The next row; `None` at the end, where a machine that was killed may leave half a row.
    fn next_row(&mut self) -> Result<Option<Row>, TruthError> {
        self.line.clear();
        self.lines.read_line(&mut self.line)?;
        let Some(line) = self.line.strip_suffix('\n') else { return Ok(None) };
        read(line, self.axes).map(Some).ok_or_else(|| TruthError::Other { line: line.to_owned() })
    }
}

/// A line as a row.
fn read(line: &str, axes: usize) -> Option<Row> {
    let mut words = line.split(',');
    let cycle = words.next()?.parse().ok()?;
    let mut truths = [AxisTruth::default(); AXES_MAX];
    for truth in truths.get_mut(..axes)? {
        let mut value = || words.next()?.parse::<f64>().ok();
        *truth = AxisTruth {
            position: Position::m(value()?),
            motor_velocity: Velocity::m_per_s(value()?),
            table_velocity: Velocity::m_per_s(value()?),
            current: Current::a(value()?),
        };
    }
    words.next().is_none().then(|| Row { cycle, axes: PerAxis::from_fn(axes, |axis| truths[axis.index()]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["x", "y"].map(str::to_owned).to_vec()
    }

    fn row(cycle: u32) -> Row {
        let axes = PerAxis::from_fn(2, |axis| AxisTruth {
            position: Position::m(0.1 + 0.2 + axis.index() as f64),
            motor_velocity: Velocity::m_per_s(-1.0 / 3.0),
            table_velocity: Velocity::m_per_s(f64::MIN_POSITIVE / 8.0),
            current: Current::a(-0.0),
        });
        Row { cycle, axes }
    }

    fn bits(axes: &PerAxis<AxisTruth>) -> Vec<[u64; 4]> {
        let of_axis = |axis: &AxisTruth| {
            let AxisTruth { position, motor_velocity, table_velocity, current } = *axis;
            [position.as_m(), motor_velocity.as_m_per_s(), table_velocity.as_m_per_s(), current.as_a()]
                .map(f64::to_bits)
        };
        axes.as_slice().iter().map(of_axis).collect()
    }

    fn told(rows: &str) -> Told<std::io::Cursor<String>> {
        let text = format!("{}\n{rows}", heading(&names()));
        Told::begin(std::io::Cursor::new(text), &names()).unwrap()
    }

    #[test]
    fn a_row_comes_back_to_the_bit_and_earlier_ones_are_passed_over() {
        let rows: String = [u32::MAX, 0, 0, 2].map(|cycle| format!("{}\n", row(cycle))).concat();
        let mut told = told(&rows);
        let mut of_cycle = |cycle| told.of_cycle(cycle).map(|axes| axes.map(|axes| bits(&axes)));
        assert_eq!(of_cycle(0).unwrap(), Some(bits(&row(0).axes)));
        assert_eq!(of_cycle(1).unwrap(), None, "its SYNC was not heard");
        assert_eq!(of_cycle(2).unwrap(), Some(bits(&row(2).axes)));
        assert!(matches!(of_cycle(3), Err(TruthError::Ended { cycle: 3 })));
    }

    #[test]
    fn what_is_no_row_of_this_machine_is_refused() {
        let whole = row(5).to_string();
        let short = whole.rsplit_once(',').unwrap().0.to_owned();
        for line in [&short, &format!("{whole},1"), &whole.replace('5', "five")] {
            let error = told(&format!("{line}\n")).of_cycle(5).unwrap_err();
            assert!(matches!(error, TruthError::Other { .. }), "{line}: {error}");
        }
        assert!(matches!(told(&whole).of_cycle(5), Err(TruthError::Ended { .. })), "half a line");
        let other = Told::begin(std::io::Cursor::new("cycle,a\n"), &names());
        assert!(matches!(other, Err(TruthError::OtherAxes { .. })));
        assert!(matches!(Told::begin(std::io::empty(), &names()), Err(TruthError::Ended { .. })));
    }
}
