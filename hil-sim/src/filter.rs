//! The machine as a filter: candump lines of a host in, candump lines of the boards out.

use std::io::{self, BufWriter, Write};

use anyhow::Context;
use quadrant::base::time::Moment;
use quadrant::candump::{self, Lines};
use quadrant::rt::bus::{Bus, memory};

use crate::simulated::Simulated;

/// Frames that cross between text and boards at once.
const BUS_FRAMES: usize = 256;

pub(crate) fn run(simulated: &Simulated) -> anyhow::Result<()> {
    let mut rack = simulated.rack();
    let (mut host, mut boards) = memory::pair(BUS_FRAMES);
    let mut lines = Lines::new(io::stdin().lock());
    let mut out = BufWriter::new(io::stdout().lock());
    while let Some(line) = lines.next_frame()? {
        host.send(&line.frame).context("the bus to the boards")?;
        rack.serve(&mut boards);
        while let Some(answer) = host.receive(Moment::ZERO) {
            // A reader that has gone away ends the session.
            match candump::write(&mut out, line.wall_ns, &line.interface, &answer.frame) {
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
                written => written.context("standard output")?,
            }
        }
    }
    out.flush().context("standard output")
}
