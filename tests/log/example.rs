//! A run to log: its header, its records, and how records are compared.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use quadrant::base::axis::{AxisId, PerAxis};
use quadrant::base::command::{Command, Limits, Terms};
use quadrant::base::fault::Fault;
use quadrant::base::record::{
    Arrival, Arrivals, AxisRecord, BusRecord, CycleRecord, LinkCounts, ModeTag, Refusal, Stage, Timing,
};
use quadrant::base::sample::{Freshness, RawFeedback, Sample};
use quadrant::base::setpoint::Setpoint;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Acceleration, Current, Position, Velocity};
use quadrant::log::{Header, LogError, Pace, Reader, WriteOutcome, Writer};

pub(crate) const WALL_AT_ZERO_NS: i64 = 1_800_000_000_000_000_000;

pub(crate) fn header(axes: usize) -> Header {
    Header {
        project_version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: "0123abc".to_owned(),
        machine_name: "reference".to_owned(),
        machine_text: "# machine\n[axis.x]\nlead-m = 0.016\n".to_owned(),
        sheets: BTreeMap::from([("board".to_owned(), "[identity]\n".to_owned())]),
        seed: 7,
        pace: Pace::Virtual,
        wall_at_zero_ns: WALL_AT_ZERO_NS,
        axes: ["x", "y", "z"][..axes].iter().map(|name| (*name).to_owned()).collect(),
        period: Span::us(500),
        gain_sets: vec!["standard".to_owned()],
        motions: BTreeMap::from([(1, serde_json::json!({"circle": {"radius_mm": 150}}))]),
        extra: BTreeMap::from([("operator".to_owned(), "test".to_owned())]),
    }
}

/// A cycle of a smooth motion, different in every field from its neighbours.
pub(crate) fn record(axes: usize, cycle: u64) -> CycleRecord {
    let at = Moment::ZERO + Span::us(500) * cycle as i64;
    let phase = cycle as f64 * 1e-3;
    let axis = |axis: AxisId| AxisRecord {
        refusal: Refusal::None,
        mode: ModeTag::Moving,
        fault: (cycle % 1000 == 999).then_some(Fault::FollowingError),
        gain_set: 1,
        setpoint: Setpoint {
            position: Position::m(phase.sin()),
            velocity: Velocity::m_per_s(phase.cos()),
            acceleration: Acceleration::m_per_s2(-phase.sin()),
        },
        sample: Sample {
            raw: RawFeedback {
                motor_counts: cycle as u32 * 17,
                sequence: cycle as u8,
                ..RawFeedback::default()
            },
            freshness: Freshness::Fresh,
            age_cycles: 0,
            position: Position::m((phase - 0.01).sin()),
            velocity: Velocity::m_per_s(phase.cos()),
            table_position: Position::m(if axis == AxisId::X { f64::NAN } else { phase }),
            current: Current::a(phase.tan()),
        },
        arrivals: Arrivals {
            motor: Arrival { place: 1, at: at + Span::us(90) },
            table: Arrival { place: 3, at: at + Span::us(140) },
        },
        link: LinkCounts { fresh: cycle as u32, ..LinkCounts::default() },
        command: Command {
            current: Current::a(phase.sin() * 3.0),
            control_word: 15,
            terms: Terms {
                following_error: Position::m(phase.sin() - (phase - 0.01).sin()),
                ..Terms::default()
            },
            limits: Limits::CURRENT,
        },
    };
    CycleRecord {
        cycle,
        timing: Timing {
            scheduled: at,
            awaited: at,
            woke: at + Span::us(3),
            collected: at + Span::us(95),
            decided: at + Span::us(97),
            previous_finished: at - Span::us(400),
        },
        bus: BusRecord { reports: cycle as u32 / 900, ..BusRecord::default() },
        overruns: cycle / 700,
        lost_records: 0,
        stage: Stage { motion: 1, is_measured: cycle > 100 },
        axes: PerAxis::from_fn(axes, axis),
    }
}

/// Writes `records` with a ring of `capacity`, waiting for room as a virtual run does.
pub(crate) fn write_with(
    path: &Path,
    axes: usize,
    capacity: usize,
    records: impl Iterator<Item = CycleRecord>,
) -> (WriteOutcome, u64) {
    let (mut ring, consumer) = rtrb::RingBuffer::new(capacity);
    let lost = Arc::new(AtomicU64::new(0));
    let writer =
        Writer::start(path, header(axes), consumer, rtrb::RingBuffer::new(1).1, Arc::clone(&lost)).unwrap();
    for mut record in records {
        while let Err(rtrb::PushError::Full(back)) = ring.push(record) {
            record = back;
            std::thread::yield_now();
        }
    }
    drop(ring);
    let outcome = writer.join();
    (outcome, lost.load(Ordering::Relaxed))
}

pub(crate) fn write(path: &Path, axes: usize, count: u64) -> WriteOutcome {
    write_with(path, axes, 4096, (0..count).map(|cycle| record(axes, cycle))).0
}

pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Equal to the bit: a NaN equals itself, 0 does not equal -0.
pub(crate) fn is_same(one: &CycleRecord, other: &CycleRecord) -> bool {
    let bits = |record: &CycleRecord| -> Vec<u64> {
        record.axes.as_slice().iter().flat_map(floats).map(f64::to_bits).collect()
    };
    // A NaN equals nothing: what `floats` has is compared by its bits alone.
    let others = |record: &CycleRecord| {
        let mut record = *record;
        for (_, AxisRecord { setpoint, sample, command, .. }) in record.axes.iter_mut() {
            *setpoint = Setpoint::default();
            *sample = Sample {
                position: Position::ZERO,
                velocity: Velocity::ZERO,
                table_position: Position::ZERO,
                current: Current::ZERO,
                ..*sample
            };
            (command.current, command.terms) = (Current::ZERO, Terms::default());
        }
        record
    };
    bits(one) == bits(other) && others(one) == others(other)
}

pub(crate) fn floats(axis: &AxisRecord) -> [f64; 17] {
    let AxisRecord { setpoint, sample, command, .. } = axis;
    let Terms {
        following_error,
        expected_position,
        expected_velocity,
        velocity_command,
        excitation,
        proportional,
        integral,
        friction,
        inertia,
    } = command.terms;
    [
        setpoint.position.as_m(),
        setpoint.velocity.as_m_per_s(),
        setpoint.acceleration.as_m_per_s2(),
        sample.position.as_m(),
        sample.velocity.as_m_per_s(),
        sample.table_position.as_m(),
        sample.current.as_a(),
        command.current.as_a(),
        following_error.as_m(),
        expected_position.as_m(),
        expected_velocity.as_m_per_s(),
        velocity_command.as_m_per_s(),
        excitation.as_m_per_s(),
        proportional.as_nm(),
        integral.as_nm(),
        friction.as_nm(),
        inertia.as_nm(),
    ]
}

/// A log of `chunks` chunks of 50 records each: the records of a chunk are there at once, and the next follow when
/// the chunk is in the file.
pub(crate) fn write_in_chunks(path: &Path, chunks: u64) {
    let (mut ring, consumer) = rtrb::RingBuffer::new(64);
    let writer =
        Writer::start(path, header(2), consumer, rtrb::RingBuffer::new(1).1, Arc::default()).unwrap();
    for chunk in 0..chunks {
        let cycles = chunk * CHUNK_RECORDS..(chunk + 1) * CHUNK_RECORDS;
        ring.write_chunk_uninit(CHUNK_RECORDS as usize)
            .unwrap()
            .fill_from_iter(cycles.map(|cycle| record(2, cycle)));
        while whole_chunks(&std::fs::read(path).unwrap()) <= chunk {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    drop(ring);
    assert!(writer.join().is_complete);
}

/// Chunks that a log under way has whole: each record is its kind, its length in eight bytes, its content.
fn whole_chunks(bytes: &[u8]) -> u64 {
    const CHUNK: u8 = 6;
    let mut rest = bytes.get(mcap::MAGIC.len()..).unwrap_or_default();
    let mut chunks = 0;
    while let Some((head, behind)) = rest.split_first_chunk::<9>() {
        let length = u64::from_le_bytes(head[1..].try_into().unwrap());
        let Some(next) = behind.get(length as usize..) else { break };
        chunks += u64::from(head[0] == CHUNK);
        rest = next;
    }
    chunks
}

/// Records in a chunk of [`write_in_chunks`].
pub(crate) const CHUNK_RECORDS: u64 = 50;

/// Everything that can be read of a log in memory: records, how it ended, whether it was cut.
pub(crate) fn read(bytes: &[u8]) -> (Vec<CycleRecord>, Result<(), LogError>, bool) {
    let mut records = Vec::new();
    let mut reader = match Reader::new(std::io::Cursor::new(bytes), Path::new("run.mcap")) {
        Ok(reader) => reader,
        Err(error) => return (records, Err(error), false),
    };
    for record in &mut reader {
        match record {
            Ok(record) => records.push(record),
            Err(error) => return (records, Err(error), reader.is_truncated()),
        }
    }
    let is_truncated = reader.is_truncated();
    (records, Ok(()), is_truncated)
}

/// Where each chunk of a complete log starts and how long it is, by the log's own index.
pub(crate) fn chunks(bytes: &[u8]) -> Vec<(usize, usize)> {
    let index = mcap::Summary::read(bytes).unwrap().unwrap();
    index
        .chunk_indexes
        .iter()
        .map(|chunk| (chunk.chunk_start_offset as usize, chunk.chunk_length as usize))
        .collect()
}
