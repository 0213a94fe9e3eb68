//! Frames as lines of `candump -L` and back. Lines that are no data frame of an 11-bit identifier (error
//! frames, remote frames, other identifiers) are not for the boards and are passed over.

use std::io::{self, BufReader, Read, Write};

use anyhow::Context;
use quadrant::rt::bus::{Format, Frame, Id};
use socketcan::dump::{CanDumpRecord, Reader};
use socketcan::{CanAnyFrame, CanDataFrame, CanFdFrame, EmbeddedFrame, StandardId};

/// A frame with where and when it was seen.
#[derive(Debug)]
pub(crate) struct Line {
    /// Microseconds since 1970.
    pub(crate) time_us: u64,
    /// Name of the interface.
    pub(crate) interface: String,
    /// The frame.
    pub(crate) frame: Frame,
}

/// Reads lines.
pub(crate) struct Lines<R> {
    reader: Reader<BufReader<R>>,
    line: u64,
}

impl<R: Read> Lines<R> {
    /// Lines of a text.
    pub(crate) fn new(text: R) -> Self {
        Self { reader: Reader::from_reader(text), line: 0 }
    }

    /// The next frame for the boards; `None` at the end of the text.
    pub(crate) fn next_frame(&mut self) -> anyhow::Result<Option<Line>> {
        loop {
            self.line += 1;
            let record = self.reader.next_record().with_context(|| format!("line {}", self.line))?;
            let Some(record) = record else { return Ok(None) };
            if let Some(frame) = frame(&record.frame) {
                let interface = record.device.to_string();
                return Ok(Some(Line { time_us: record.t_us, interface, frame }));
            }
        }
    }
}

fn frame(seen: &CanAnyFrame) -> Option<Frame> {
    let (id, format, payload) = match seen {
        CanAnyFrame::Normal(frame) => (frame.id(), Format::Classic, frame.data()),
        CanAnyFrame::Fd(frame) => (frame.id(), Format::Fd { bit_rate_switch: frame.is_brs() }, frame.data()),
        CanAnyFrame::Remote(_) | CanAnyFrame::Error(_) => return None,
    };
    match id {
        socketcan::Id::Standard(id) => Frame::from_slice(Id::new(id.as_raw())?, format, payload),
        socketcan::Id::Extended(_) => None,
    }
}

/// Writes a frame as a line.
pub(crate) fn write(out: &mut impl Write, time_us: u64, interface: &str, frame: &Frame) -> io::Result<()> {
    let id = StandardId::new(frame.id().raw()).ok_or(io::ErrorKind::InvalidData)?;
    let seen = match frame.format() {
        Format::Classic => CanDataFrame::new(id, frame.payload()).map(CanAnyFrame::Normal),
        // A report of a controller; boards send none.
        Format::Report => None,
        Format::Fd { bit_rate_switch } => CanFdFrame::new(id, frame.payload()).map(|mut fd| {
            fd.set_brs(bit_rate_switch);
            CanAnyFrame::Fd(fd)
        }),
    };
    let frame = seen.ok_or(io::ErrorKind::InvalidData)?;
    writeln!(out, "{}", CanDumpRecord { t_us: time_us, device: interface.into(), frame, direction: None })
}
