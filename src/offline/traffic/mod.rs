//! The traffic of a run: what its log tells of the frames on the bus, and what frames tell of a run.
//!
//! ```text
//!   log ─► record + inputs ─► Frames ─► export ─► text of candump ─► import ─► record + inputs ─► log
//! ```
//!
//! A cycle is SYNC, what the host received in it, and its commands, in this order. The record holds the
//! feedback that was used, the inputs every other frame; SYNC and commands are built again from what was
//! decided, as `rt/drive` built them then.
//! Invariant: a frame that the host received or that the bus took from it comes out as it was, in its place.

pub mod export;

use crate::base::axis::{AxisId, PerAxis};
use crate::base::frame::{Frame, Received};
use crate::base::input::{Input, What};
use crate::base::record::{Arrival, CycleRecord, Refusal};
use crate::base::sample::Freshness;
use crate::config::Machine;
use crate::rt::drive::raw_command;
use crate::rt::wire::command::{RawCommand, encode_sync};
use crate::rt::wire::scaling::AxisScale;
use crate::rt::wire::{Address, Layout, Malformed, Node};

/// How the frames of a machine follow from its records.
#[derive(Clone, Copy, Debug)]
pub struct Frames {
    nodes: PerAxis<Node>,
    scales: PerAxis<AxisScale>,
    layout: Layout,
}

impl Frames {
    /// Those of a machine.
    pub fn of(machine: &Machine) -> Self {
        Self {
            nodes: machine.axes.map(|_, axis| axis.node),
            scales: machine.axes.map(|_, axis| axis.scale),
            layout: machine.bus.layout,
        }
    }

    /// The SYNC of a cycle, unless the bus refused it.
    pub fn sync(&self, record: &CycleRecord) -> Option<Frame> {
        (record.bus.sync == Refusal::None).then(|| encode_sync(record.cycle as u32))
    }

    /// What the host received in a cycle, in the order in which it came.
    pub fn received(&self, record: &CycleRecord, inputs: &[Input]) -> Vec<Received> {
        let fresh = record.axes.iter().filter(|(_, row)| row.sample.freshness == Freshness::Fresh);
        let feedback = fresh.flat_map(|(axis, row)| {
            let pieces = self.layout.feedback(self.nodes[axis], &row.sample.raw);
            let arrivals = [row.arrivals.motor, row.arrivals.table].into_iter();
            arrivals.zip(pieces).map(|(Arrival { place, at }, frame)| (place, Received { frame, at }))
        });
        let aside = inputs.iter().filter_map(|input| match input.what {
            What::Frame { place, received } => Some((place, received)),
            What::Order(_) | What::Before(_) => None,
        });
        let mut frames: Vec<_> = feedback.chain(aside).collect();
        frames.sort_by_key(|(place, _)| *place);
        frames.into_iter().map(|(_, received)| received).collect()
    }

    /// The command of a cycle to an axis, whether or not the bus took it.
    pub fn command(&self, record: &CycleRecord, axis: AxisId) -> Frame {
        let sequence = record.cycles_run() as u8;
        let raw = raw_command(&self.scales[axis], &record.axes[axis].command, record.cycle, sequence);
        self.layout.command(self.nodes[axis], &raw)
    }

    /// The commands of a cycle, without those that the bus refused.
    pub fn commands(&self, record: &CycleRecord) -> Vec<Frame> {
        let taken = record.axes.iter().filter(|(_, row)| row.refusal == Refusal::None);
        taken.map(|(axis, _)| self.command(record, axis)).collect()
    }

    /// What a command frame says.
    pub fn decode_command(&self, frame: &Frame) -> Result<RawCommand, Malformed> {
        self.layout.decode_command(frame)
    }

    /// The axis that a command is for; `None` for any other frame.
    pub fn axis_commanded(&self, frame: &Frame) -> Option<AxisId> {
        let Some(Address::Command(to)) = Address::of(frame.id()) else { return None };
        self.nodes.iter().find(|(_, node)| **node == to).map(|(axis, _)| axis)
    }
}
