//! Logs of one machine, opened together.
//!
//! A log carries its machine file, and with it what the identification takes as known: lead, efficiency, torque
//! constant, mass of the table, damping, encoder. Logs of the same file belong together, whatever was run.
//! Each is read once: its columns and what was excited in it come from one pass over its cycles.
//! Invariant: logs of different machine files are refused, not averaged.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::axis::{self, IdentifiedAxis};
use super::frequency;
use super::frequency::spectra::{Collector, Observed};
use super::logged::{LoggedAxis, LoggedError, Settings};
use crate::config::machine::AXIS_NAMES;
use crate::config::problem::FileProblems;
use crate::config::{self, Machine};
use crate::log::{LogError, Reader};
use crate::offline::recorded::{CyclesOf, RecordedCycle};
use crate::offline::trace::{Trace, TraceError};

/// Why logs are not identified.
#[derive(Debug, Error)]
pub enum LogsError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// Its records are no trace.
    #[error("{log}: {cause}")]
    Trace {
        /// Which.
        log: PathBuf,
        /// Why not.
        cause: TraceError,
    },
    /// Its machine file is none of today's.
    #[error("the machine file in {log} is refused: {cause}")]
    Machine {
        /// Which.
        log: PathBuf,
        /// Why.
        cause: Box<FileProblems>,
    },
    /// Different machines.
    #[error("{other} is a log of another machine file than {first}: identify each for itself")]
    Mixed {
        /// The first.
        first: PathBuf,
        /// The one that differs.
        other: PathBuf,
    },
    /// No log was named.
    #[error("no log")]
    None,
    /// An axis cannot be identified.
    #[error("axis {axis}: {cause}")]
    Axis {
        /// Which.
        axis: String,
        /// Why not.
        cause: LoggedError,
    },
}

/// Logs of one machine.
#[derive(Debug)]
pub struct Logs {
    /// What they say of the machine.
    pub machine: Machine,
    /// Commit of the program that made the first.
    pub commit: String,
    /// Wall clock at its start, ns since 1970.
    pub wall_at_zero_ns: i64,
    /// Where they are.
    pub paths: Vec<PathBuf>,
    /// Their columns.
    pub traces: Vec<Trace>,
    /// What was excited in them.
    pub excited: Vec<Observed>,
    /// What is wrong with them, one sentence each.
    pub warnings: Vec<String>,
}

impl Logs {
    /// Opens logs and reads them whole.
    ///
    /// # Errors
    /// When one cannot be read, or is one of another machine file.
    pub fn open(paths: &[PathBuf]) -> Result<Self, LogsError> {
        let mut all: Option<Self> = None;
        for path in paths {
            let one = Self::read(path)?;
            match &mut all {
                None => all = Some(one),
                Some(all)
                    if all.machine.text != one.machine.text || all.machine.sheets != one.machine.sheets =>
                {
                    return Err(LogsError::Mixed { first: all.paths[0].clone(), other: path.clone() });
                }
                Some(all) => {
                    all.paths.extend(one.paths);
                    all.traces.extend(one.traces);
                    all.excited.extend(one.excited);
                    all.warnings.extend(one.warnings);
                }
            }
        }
        all.ok_or(LogsError::None)
    }

    fn read(path: &Path) -> Result<Self, LogsError> {
        let mut reader = Reader::open(path)?;
        let header = reader.header().clone();
        let source = format!("{} in {}", header.machine_name, path.display());
        let machine = config::from_texts(&source, &header.machine_text, &header.sheets)
            .map_err(|cause| LogsError::Machine { log: path.to_owned(), cause })?;
        let mut failed = None;
        let mut excited = Collector::new(machine.cycle.period);
        let mut cycles = CyclesOf(&mut reader);
        let records = std::iter::from_fn(|| match cycles.next()? {
            Ok(RecordedCycle { record, inputs }) => {
                excited.see(&record, inputs.iter());
                Some(record)
            }
            Err(error) => {
                failed = Some(error);
                None
            }
        });
        let trace = Trace::from_records(records);
        if let Some(error) = failed {
            return Err(error.into());
        }
        let trace = trace.map_err(|cause| LogsError::Trace { log: path.to_owned(), cause })?;
        let mut warnings = Vec::new();
        if reader.is_truncated() {
            warnings.push(format!("{} ends without its index; what was readable is used", path.display()));
        }
        Ok(Self {
            machine,
            commit: header.commit,
            wall_at_zero_ns: header.wall_at_zero_ns,
            paths: vec![path.to_owned()],
            traces: vec![trace],
            excited: excited.finish(),
            warnings,
        })
    }

    /// Each axis of the machine, by its name.
    ///
    /// # Errors
    /// When the logs cannot be taken together; named by axis.
    pub fn identify(&self, settings: Settings) -> Result<Vec<(String, LoggedAxis)>, LogsError> {
        let one = |id: crate::base::axis::AxisId| {
            let name = AXIS_NAMES[id.index()].to_owned();
            match LoggedAxis::identify(&self.traces, id, &self.machine.axes[id], settings) {
                Ok(found) => Ok((name, found)),
                Err(cause) => Err(LogsError::Axis { axis: name, cause }),
            }
        };
        self.machine.axes.axes().map(one).collect()
    }

    /// Each axis of the machine with all that the logs tell of it, what was excited too.
    ///
    /// # Errors
    /// When the logs cannot be taken together.
    pub fn identify_all(&self, settings: Settings) -> Result<Vec<IdentifiedAxis>, LogsError> {
        let logged = self.identify(settings)?;
        let responses = frequency::of_observed(&axis::sliding(&self.machine, &logged), &self.excited);
        Ok(IdentifiedAxis::all(logged, responses, settings))
    }

    /// The logs as they shall stand on a page.
    pub fn names(&self) -> String {
        let names: Vec<String> = self.paths.iter().map(|path| path.display().to_string()).collect();
        names.join(", ")
    }
}
