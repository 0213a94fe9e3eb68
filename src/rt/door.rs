//! The only way across the fence around the cycle: orders in, records out.
//!
//! The cycle asks its source of orders for at most one at a time and never waits for one. Records leave
//! through a wait-free ring and the inputs of their cycle through another; what finds its ring full is
//! dropped and counted, and the count travels in every later record.
//! Invariant: nothing on the cycle's side of the door blocks, allocates or frees.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::base::input::{INPUTS_MAX, Input, Inputs};
pub use crate::base::order::Order;
use crate::base::record::CycleRecord;
use crate::base::time::Span;

/// Where orders come from: the ring from outside, or a procedure that runs beside the cycle.
pub trait Orders {
    /// The next order, if one is due; `last` is what happened in the cycle before. Asked at the ticks
    /// of the position loop.
    fn next(&mut self, last: &CycleRecord) -> Option<Order>;
    /// Whether nothing more is to be ordered after `last`. The run then ends once the axes are at rest.
    fn is_done(&self, last: &CycleRecord) -> bool;
}

/// Where records go.
pub trait Records {
    /// Take one cycle's record and what the cycle was told. Must not wait on a machine.
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs);
    /// Records and inputs lost so far, anywhere on the way to the disk.
    fn lost(&self) -> u64;
}

/// The cycle's end of the record ring.
#[derive(Debug)]
pub struct RecordRing {
    ring: rtrb::Producer<CycleRecord>,
    inputs: rtrb::Producer<Input>,
    lost: Arc<AtomicU64>,
    cycles: Arc<AtomicU64>,
    overruns: Arc<AtomicU64>,
    wake_error_max: Span,
    wake_error_ns_max: Arc<AtomicU64>,
}

/// The other end: records to be written, and the counters shared with the cycle.
#[derive(Debug)]
pub struct RecordDrain {
    /// Records in order.
    pub ring: rtrb::Consumer<CycleRecord>,
    /// Inputs in order; those of a record are here before it is.
    pub inputs: rtrb::Consumer<Input>,
    /// Records and inputs lost; the writer adds what it cannot write.
    pub lost: Arc<AtomicU64>,
    /// Cycles run so far, for progress and supervision.
    pub cycles: Arc<AtomicU64>,
    /// Periods skipped so far.
    pub overruns: Arc<AtomicU64>,
    /// The latest wake-up so far, ns from its place on the grid.
    pub wake_error_ns_max: Arc<AtomicU64>,
}

/// Inputs on their way: those of a second host, three frames in each period, for 2.7 s at 2 kHz.
const RING_INPUTS: usize = 16_384;

/// A ring for `capacity` records.
pub fn record_ring(capacity: usize) -> (RecordRing, RecordDrain) {
    let (producer, consumer) = rtrb::RingBuffer::new(capacity);
    let (inputs_producer, inputs) = rtrb::RingBuffer::new(RING_INPUTS);
    let [lost, cycles, overruns, wake_error_ns_max] = [(); 4].map(|()| Arc::new(AtomicU64::new(0)));
    let near = RecordRing {
        ring: producer,
        inputs: inputs_producer,
        lost: Arc::clone(&lost),
        cycles: Arc::clone(&cycles),
        overruns: Arc::clone(&overruns),
        wake_error_max: Span::ZERO,
        wake_error_ns_max: Arc::clone(&wake_error_ns_max),
    };
    (near, RecordDrain { ring: consumer, inputs, lost, cycles, overruns, wake_error_ns_max })
}

impl RecordRing {
    /// Whether a record and all inputs that a cycle can have would find room.
    pub fn has_room(&self) -> bool {
        self.ring.slots() > 0 && self.inputs.slots() >= INPUTS_MAX
    }
    /// Whether nobody takes records any more.
    pub fn is_abandoned(&self) -> bool {
        self.ring.is_abandoned()
    }
}

impl Records for RecordRing {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        for input in inputs.iter() {
            if self.inputs.push(*input).is_err() {
                self.lost.fetch_add(1, Ordering::Relaxed);
            }
        }
        if let Ok(slot) = self.ring.write_chunk_uninit(1) {
            // Straight into its slot: pushed by value, a record would be copied once more.
            slot.fill_from_iter(std::iter::once(record).copied());
        } else {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        // Written here alone.
        self.cycles.store(self.cycles.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        self.overruns.store(record.overruns, Ordering::Relaxed);
        let wake_error = record.timing.wake_error();
        if wake_error > self.wake_error_max {
            self.wake_error_max = wake_error;
            self.wake_error_ns_max.store(wake_error.as_ns().unsigned_abs(), Ordering::Relaxed);
        }
    }
    fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

/// The same records to two places, as a log and a live view; losses are those of the first, and a
/// trace shows its own as missing cycles.
#[derive(Debug)]
pub struct Both<A, B>(pub A, pub B);

impl<A: Records, B: Records> Records for Both<A, B> {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        self.0.put(record, inputs);
        self.1.put(record, inputs);
    }
    fn lost(&self) -> u64 {
        self.0.lost()
    }
}

/// Perhaps a second place.
impl<R: Records> Records for Option<R> {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        if let Some(records) = self {
            records.put(record, inputs);
        }
    }
    fn lost(&self) -> u64 {
        self.as_ref().map_or(0, Records::lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_wake_up_is_shared() {
        let (mut near, far) = record_ring(8);
        for late_us in [3, 40, 7] {
            let mut record = CycleRecord::empty(2);
            record.timing.woke = record.timing.awaited + Span::us(late_us);
            near.put(&record, &Inputs::default());
        }
        assert_eq!(far.wake_error_ns_max.load(Ordering::Relaxed), 40_000);
    }

    #[test]
    fn a_full_ring_counts_and_keeps_the_oldest() {
        let (mut near, mut far) = record_ring(2);
        for cycle in 0..5 {
            near.put(&CycleRecord { cycle, ..CycleRecord::empty(2) }, &Inputs::default());
        }
        assert_eq!(near.lost(), 3);
        assert_eq!(far.lost.load(Ordering::Relaxed), 3);
        assert_eq!(far.cycles.load(Ordering::Relaxed), 5);
        let kept: Vec<u64> = std::iter::from_fn(|| far.ring.pop().ok()).map(|r| r.cycle).collect();
        assert_eq!(kept, [0, 1]);
    }
}
