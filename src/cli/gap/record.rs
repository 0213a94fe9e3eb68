//! Lists runs, and records them one after the other, each into a log of its own.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::super::identify::experiments::header;
use super::super::live::{Job, outcome_of, with_losses};
use super::super::{Outcome, view};
use crate::config::Machine;
use crate::offline::gap::plan::Recording;
use crate::offline::identify::plan::Request;
use crate::run::{Origin, Place};

/// Where runs are recorded, and what is kept of them.
pub(super) struct Recorder<'a> {
    pub(super) machine: &'a Machine,
    /// Behind the boards, where the machine is simulated in this process.
    pub(super) plant: &'a Machine,
    pub(super) place: &'a Place<'a>,
    pub(super) allow_jitter: bool,
    pub(super) stop_wish: Arc<AtomicBool>,
    pub(super) folder: &'a Path,
}

impl Recorder<'_> {
    /// Records one: its log, and how it ended.
    pub(super) fn record(&self, run: &Recording, request: &Request) -> anyhow::Result<(PathBuf, Outcome)> {
        let Self { machine, plant, place, .. } = *self;
        let log = self.folder.join(format!("{}.mcap", run.name));
        let job = Job {
            machine,
            plant,
            programme: run.plan.programme(),
            place,
            allow_jitter: self.allow_jitter,
            stop_wish: Arc::clone(&self.stop_wish),
            log: &log,
            title: &run.name,
            duration_s: run.plan.duration_s(),
        };
        let header = |origin: &Origin| header(machine, plant, request, &run.plan, origin, place);
        let (recorded, ()) = job.run(header, |_| (None, ()))?;
        let outcome = with_losses(outcome_of(&recorded.ending), &recorded.log, recorded.lost_records);
        Ok((log, outcome))
    }
}

/// What runs do and show.
pub(super) fn listed(runs: &[Recording]) -> String {
    let mut rows = view::table(&["run", "motions", "time", "shows"]);
    for run in runs {
        rows.add_row([
            run.name.clone(),
            run.plan.motions().len().to_string(),
            format!("{:.0} s", run.plan.duration_s()),
            run.shows.to_string(),
        ]);
    }
    rows.to_string()
}
