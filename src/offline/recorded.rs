//! A log cycle by cycle, for as long as nothing is missing: what replay and playback go by.
//!
//! What a cycle lost on its way to the log is counted in the next record, so one cycle is read ahead. Of the
//! last cycle of a log nobody counts it.
//! Invariant: a cycle is handed out only with all that it was told, and behind all cycles before it; where that
//! ends before the log does, it is said why.

use std::io::{Read, Seek};

use crate::base::input::Input;
use crate::base::record::CycleRecord;
use crate::log::{LogError, Reader};

/// One cycle of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedCycle {
    /// Its record.
    pub record: CycleRecord,
    /// What it was told beside.
    pub inputs: Vec<Input>,
}

/// The cycles of a log, as they stand there.
#[derive(Debug)]
pub struct CyclesOf<'a, R>(pub &'a mut Reader<R>);

impl<R: Read + Seek> Iterator for CyclesOf<'_, R> {
    type Item = Result<RecordedCycle, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let record = match self.0.next()? {
            Ok(record) => record,
            Err(error) => return Some(Err(error)),
        };
        Some(Ok(RecordedCycle { record, inputs: self.0.inputs_until(&record).to_vec() }))
    }
}

/// Why there is nothing to go by from the start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The first cycle cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// There is none.
    #[error("the log holds no cycle")]
    Empty,
    /// It begins in the middle of its run, so the state it began with is not known.
    #[error("the log begins with cycle {first} of its run: what was before is missing, so is the state")]
    Headless {
        /// Number of its first cycle.
        first: u64,
    },
}

/// The cycles of a run from its beginning.
#[derive(Debug)]
pub struct Recorded<I> {
    cycles: I,
    ahead: Option<RecordedCycle>,
    ended_early: Option<String>,
}

impl<I: Iterator<Item = Result<RecordedCycle, LogError>>> Recorded<I> {
    /// Those of a log.
    pub fn new(mut cycles: I) -> Result<Self, StartError> {
        let Some(first) = cycles.next().transpose()? else { return Err(StartError::Empty) };
        // Periods may be skipped before the first cycle is run.
        if first.record.cycle != first.record.overruns {
            return Err(StartError::Headless { first: first.record.cycle });
        }
        Ok(Self { cycles, ahead: Some(first), ended_early: None })
    }

    /// The cycle that comes next, if nothing of it was lost.
    pub fn ahead(&self) -> Option<&RecordedCycle> {
        self.ahead.as_ref()
    }

    /// Why there are no more cycles, unless it is the end of the log.
    pub fn ended_early(&self) -> Option<&str> {
        self.ended_early.as_deref()
    }
}

impl<I: Iterator<Item = Result<RecordedCycle, LogError>>> Iterator for Recorded<I> {
    type Item = RecordedCycle;

    fn next(&mut self) -> Option<RecordedCycle> {
        let cycle = self.ahead.take()?;
        match self.cycles.next() {
            None => {}
            Some(Err(error)) => self.ended_early = Some(error.to_string()),
            Some(Ok(next)) => {
                self.ended_early = lost_inputs(&cycle.record, &next.record);
                if self.ended_early.is_some() {
                    return None;
                }
                self.ended_early = gap(&cycle.record, &next.record);
                self.ahead = Some(next).filter(|_| self.ended_early.is_none());
            }
        }
        Some(cycle)
    }
}

/// How many cycles were run between two records and have none.
fn absent(before: &CycleRecord, next: &CycleRecord) -> u64 {
    next.cycles_run().saturating_sub(before.cycles_run()).saturating_sub(1)
}

/// Whether a cycle lost some of what it was told, by the next record's account.
fn lost_inputs(record: &CycleRecord, next: &CycleRecord) -> Option<String> {
    let lost = next.lost_records.saturating_sub(record.lost_records);
    (absent(record, next) == 0 && lost > 0)
        .then(|| format!("{lost} inputs of cycle {} were lost", record.cycle))
}

/// What is missing between two records, if anything is.
fn gap(before: &CycleRecord, next: &CycleRecord) -> Option<String> {
    let absent = absent(before, next);
    (absent > 0).then(|| format!("{absent} records are missing after cycle {}", before.cycle))
}
