//! What the axes really do, told beside the bus: to a file, or to the process that reads standard output.
//!
//! In lock step rows go out in blocks, because a call of the system for each would be the larger part of a
//! cycle; the host knows when (`quadrant::sim::truth::BLOCK_CYCLES`).
//! Invariant: a row that cannot be told ends the program, and with it the run.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use anyhow::Context;
use quadrant::base::axis::PerAxis;
use quadrant::rt::bus::Frame;
use quadrant::rt::wire::{Address, command};
use quadrant::sim::truth::{AxisTruth, BLOCK_CYCLES, Row, heading};

/// Where the truth goes, if anywhere.
pub(crate) struct TruthFile {
    out: Option<Box<dyn Write + Send>>,
    rows: Vec<u8>,
}

impl TruthFile {
    /// It is told to nobody.
    pub(crate) fn nowhere() -> Self {
        Self { out: None, rows: Vec::new() }
    }

    /// It is told to a file, or to standard output; axes have these names.
    pub(crate) fn open(file: &Path, axes: &[String]) -> anyhow::Result<Self> {
        let out: Box<dyn Write + Send> = if file == Path::new("-") {
            Box::new(io::stdout())
        } else {
            Box::new(
                File::create(file)
                    .with_context(|| format!("cannot write the truth to {}", file.display()))?,
            )
        };
        Ok(Self { out: Some(out), rows: format!("{}\n", heading(axes)).into_bytes() })
    }

    /// If the frame is a SYNC: the axes did this at it.
    pub(crate) fn note(
        &mut self,
        frame: &Frame,
        truths: impl FnOnce() -> PerAxis<AxisTruth>,
    ) -> anyhow::Result<()> {
        if self.out.is_none() || Address::of(frame.id()) != Some(Address::Sync) {
            return Ok(());
        }
        // What no machine takes for a SYNC moves none.
        let Ok(cycle) = command::decode_sync(frame) else { return Ok(()) };
        writeln!(self.rows, "{}", Row { cycle, axes: truths() })?;
        if (u64::from(cycle) + 1).is_multiple_of(BLOCK_CYCLES) { self.tell() } else { Ok(()) }
    }

    /// Hands out what was noted.
    pub(crate) fn tell(&mut self) -> anyhow::Result<()> {
        let Some(out) = self.out.as_mut().filter(|_| !self.rows.is_empty()) else { return Ok(()) };
        out.write_all(&self.rows).and_then(|()| out.flush()).context("cannot tell what the axes did")?;
        self.rows.clear();
        Ok(())
    }
}
