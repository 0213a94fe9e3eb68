//! The log of a run, if it is to be kept: the cycles of the run, the same over any bus.

use std::path::Path;

use anyhow::{Context, ensure};

use super::super::circle::live;
use crate::base::input::{Input, Inputs};
use crate::base::record::CycleRecord;
use crate::config::scenario::{Motion, Scenario};
use crate::log::Writer;
use crate::rt::door::{Records, record_ring};
use crate::run::{self, Origin, Place};
use crate::sim::closed_loop::Patient;

/// Records on their way to the disk.
const RING_RECORDS: usize = 1_024;

/// A log being written, or none.
pub(super) struct Log(Option<Open>);

struct Open {
    ring: Patient,
    inputs: Inputs,
    writer: Writer,
}

impl Log {
    /// Begins the log of a scenario in a folder, named as the file of the scenario.
    pub(super) fn start(
        folder: Option<&Path>,
        file: &Path,
        scenario: &Scenario,
        place: &Place<'_>,
    ) -> anyhow::Result<Self> {
        let Some(folder) = folder else { return Ok(Self(None)) };
        let stem = file.file_stem().with_context(|| format!("{} is no name of a file", file.display()))?;
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        let (machine, origin) = (&scenario.machine, Origin::soon());
        let mut header = match &scenario.motion {
            Motion::Circle { request, test } => live::header(machine, request, test, &origin, place),
            Motion::Hold(_) => run::header(machine, place, &origin, "quadrant"),
        };
        header.extra.insert("scenario".to_owned(), scenario.name.clone());
        let (ring, drain) = record_ring(RING_RECORDS);
        let path = folder.join(stem).with_extension("mcap");
        let writer = Writer::start(&path, header, drain.ring, drain.inputs, drain.lost)?;
        Ok(Self(Some(Open { ring: Patient(ring), inputs: Inputs::default(), writer })))
    }

    /// A cycle of the run.
    pub(super) fn put(&mut self, record: &CycleRecord, inputs: &[Input]) {
        let Some(open) = &mut self.0 else { return };
        open.inputs.clear();
        inputs.iter().for_each(|input| open.inputs.push(*input));
        open.ring.put(record, &open.inputs);
    }

    /// The run is over.
    ///
    /// # Errors
    /// What could not be written.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        let Some(Open { ring, writer, .. }) = self.0 else { return Ok(()) };
        drop(ring);
        let outcome = writer.join();
        let cause = outcome.first_error.unwrap_or_default();
        ensure!(
            outcome.is_complete && outcome.lost == 0,
            "{} is not complete: {cause}",
            outcome.path.display()
        );
        Ok(())
    }
}
