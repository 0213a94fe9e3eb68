//! The commands of a host beside the recorded ones.
//!
//! Invariant: two commands are the same only if every byte of their frames is.

use serde::Serialize;

use crate::base::axis::{AxisId, PerAxis};
use crate::base::frame::Frame;
use crate::base::record::CycleRecord;
use crate::offline::traffic::Frames;
use crate::rt::wire::command::RawCommand;

/// The first thing that a host commanded otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// In which cycle.
    pub cycle: u64,
    /// To which axis.
    pub axis: String,
    /// Which field of the command, with its unit; `command` if one of the two was not sent.
    pub field: &'static str,
    /// What the log says.
    pub recorded: String,
    /// What the host sent.
    pub live: String,
}

/// The commands of one cycle, on their way to be told.
#[derive(Clone, Copy, Debug)]
pub(super) struct Awaited {
    cycle: u64,
    frames: PerAxis<Frame>,
    heard: PerAxis<bool>,
    /// Whether the recorded host's bus took it; of one it refused, nothing is asked.
    taken: PerAxis<bool>,
}

impl Awaited {
    pub(super) fn of(frames: &Frames, record: &CycleRecord) -> Self {
        Self {
            cycle: record.cycle,
            frames: record.axes.map(|axis, _| frames.command(record, axis)),
            heard: record.axes.map(|_, _| false),
            taken: record.axes.map(|_, row| row.refusal == crate::base::record::Refusal::None),
        }
    }

    /// The host sent this command to an axis.
    pub(super) fn hear(&mut self, frames: &Frames, axis: AxisId, live: &Frame) -> Option<Difference> {
        if std::mem::replace(&mut self.heard[axis], true) {
            return Some(self.differs(axis, "command", "one".to_owned(), "two".to_owned()));
        }
        let recorded = &self.frames[axis];
        if recorded == live {
            return None;
        }
        let (Ok(was), Ok(is)) = (frames.decode_command(recorded), frames.decode_command(live)) else {
            let bytes = |frame: &Frame| format!("{} bytes", frame.length());
            return Some(self.differs(axis, "command", bytes(recorded), bytes(live)));
        };
        let field = fields(&was).into_iter().zip(fields(&is)).find(|(one, other)| one != other);
        let bytes = |frame: &Frame| format!("{:?} {:02x?}", frame.format(), frame.payload());
        Some(match field {
            Some(((name, was), (_, is))) => self.differs(axis, name, was.to_string(), is.to_string()),
            None => self.differs(axis, "reserved bytes", bytes(recorded), bytes(live)),
        })
    }

    /// A command that was not sent, though its cycle is over.
    pub(super) fn missing(&self) -> Option<Difference> {
        let axis = self.taken.axes().find(|axis| self.taken[*axis] && !self.heard[*axis])?;
        Some(self.differs(axis, "command", "sent".to_owned(), "not sent".to_owned()))
    }

    /// How many of this cycle were heard.
    pub(super) fn heard(&self) -> usize {
        self.heard.as_slice().iter().filter(|heard| **heard).count()
    }

    fn differs(&self, axis: AxisId, field: &'static str, recorded: String, live: String) -> Difference {
        Difference { cycle: self.cycle, axis: axis.to_string(), field, recorded, live }
    }
}

fn fields(raw: &RawCommand) -> [(&'static str, i64); 5] {
    let RawCommand { current, control_word, cycle, sequence, mode_of_operation } = *raw;
    // The place in the run first: where it differs, the rest says nothing.
    [
        ("cycle", cycle.into()),
        ("sequence", sequence.into()),
        ("control_word", control_word.into()),
        ("mode_of_operation", mode_of_operation.into()),
        ("current_ua", current.as_ua().into()),
    ]
}
