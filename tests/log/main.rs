//! The promises of a log: what was recorded is what is read, whatever happened to disk, process or
//! file in between.
#![cfg(feature = "log")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use proptest::prelude::*;
use quadrant::base::axis::{AXES_MAX, AxisId, PerAxis};
use quadrant::base::command::{Command, Limits, Terms};
use quadrant::base::fault::Fault;
use quadrant::base::record::{AxisRecord, CycleRecord, ModeTag, Stage, Timing};
use quadrant::base::sample::{Freshness, RawFeedback, Sample};
use quadrant::base::setpoint::Setpoint;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Acceleration, Current, Position, Torque, Velocity};
use quadrant::log::{Header, Pace, Reader, WriteOutcome, Writer};

const WALL_AT_ZERO_NS: i64 = 1_800_000_000_000_000_000;

fn header(axes: usize) -> Header {
    Header {
        project_version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: "0123abc".to_owned(),
        machine_name: "reference".to_owned(),
        machine_text: "# machine\n[axis.x]\nlead-m = 0.016\n".to_owned(),
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
fn record(axes: usize, cycle: u64) -> CycleRecord {
    let at = Moment::ZERO + Span::us(500) * cycle as i64;
    let phase = cycle as f64 * 1e-3;
    let axis = |axis: AxisId| AxisRecord {
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
        timing: Timing { scheduled: at, woke: at + Span::us(3), previous_finished: at - Span::us(400) },
        overruns: cycle / 700,
        lost_records: 0,
        stage: Stage { motion: 1, is_measured: cycle > 100 },
        axes: PerAxis::from_fn(axes, axis),
    }
}

/// Writes `records` with a ring of `capacity`, waiting for room as a virtual run does.
fn write_with(
    path: &Path,
    axes: usize,
    capacity: usize,
    records: impl Iterator<Item = CycleRecord>,
) -> (WriteOutcome, u64) {
    let (mut ring, consumer) = rtrb::RingBuffer::new(capacity);
    let lost = Arc::new(AtomicU64::new(0));
    let writer = Writer::start(path, header(axes), consumer, Arc::clone(&lost)).unwrap();
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

fn write(path: &Path, axes: usize, count: u64) -> WriteOutcome {
    write_with(path, axes, 4096, (0..count).map(|cycle| record(axes, cycle))).0
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Equal to the bit: a NaN equals itself, 0 does not equal -0.
fn is_same(one: &CycleRecord, other: &CycleRecord) -> bool {
    let bits = |record: &CycleRecord| -> Vec<u64> {
        record.axes.as_slice().iter().flat_map(floats).map(f64::to_bits).collect()
    };
    // Text makes every NaN equal; the slots of axes that the machine does not have are not shown.
    let text = |record: &CycleRecord| {
        let CycleRecord { cycle, timing, overruns, lost_records, stage, axes } = record;
        format!("{cycle} {timing:?} {overruns} {lost_records} {stage:?} {:?}", axes.as_slice())
    };
    bits(one) == bits(other) && text(one) == text(other)
}

fn floats(axis: &AxisRecord) -> [f64; 16] {
    let AxisRecord { setpoint, sample, command, .. } = axis;
    let Terms {
        following_error,
        expected_position,
        expected_velocity,
        velocity_command,
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
        proportional.as_nm(),
        integral.as_nm(),
        friction.as_nm(),
        inertia.as_nm(),
    ]
}

#[test]
fn what_was_written_is_read() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    let outcome = write(&path, 2, 5000);
    assert_eq!(
        outcome,
        WriteOutcome { path: path.clone(), written: 5000, lost: 0, is_complete: true, first_error: None }
    );
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!(reader.header(), &header(2));
    for cycle in 0..5000 {
        let read = reader.next().unwrap().unwrap();
        assert!(is_same(&read, &record(2, cycle)), "cycle {cycle}: {read:?}");
    }
    assert!(reader.next().is_none());
    assert!(!reader.is_truncated());
}

/// Every bit pattern of every field, in every number of axes.
fn any_record() -> impl Strategy<Value = CycleRecord> {
    let timing = (any::<i64>(), any::<i64>(), any::<i64>()).prop_map(|(scheduled, woke, finished)| Timing {
        scheduled: Moment::ns(scheduled),
        woke: Moment::ns(woke),
        previous_finished: Moment::ns(finished),
    });
    let stage = (any::<u32>(), any::<bool>()).prop_map(|(motion, is_measured)| Stage { motion, is_measured });
    let axes = (1..=AXES_MAX, proptest::array::uniform3(any_axis()));
    (any::<(u64, u64, u64)>(), timing, stage, axes).prop_map(
        |((cycle, overruns, lost_records), timing, stage, (count, axes))| {
            let axes = PerAxis::from_fn(count, |axis| axes[axis.index()]);
            CycleRecord { cycle, timing, overruns, lost_records, stage, axes }
        },
    )
}

fn any_axis() -> impl Strategy<Value = AxisRecord> {
    let float = || any::<u64>().prop_map(f64::from_bits);
    let raw = (any::<(u32, u32, i32, u32)>(), any::<(u16, u16, u8, u8)>()).prop_map(
        |(
            (motor_counts, table_counts, current_ua, board_time_us),
            (answers_cycle, status_word, sequence, board_flags),
        )| {
            RawFeedback {
                motor_counts,
                table_counts,
                current_ua,
                board_time_us,
                answers_cycle,
                status_word,
                sequence,
                board_flags,
            }
        },
    );
    let codes = (
        prop::sample::select(&ModeTag::ALL[..]),
        prop::option::of(prop::sample::select(&Fault::ALL[..])),
        prop::sample::select(vec![Freshness::Never, Freshness::Fresh, Freshness::Stale]),
        any::<u8>().prop_map(Limits::from_bits),
        any::<(u8, u32, u16)>(),
    );
    (raw, codes, proptest::array::uniform16(float())).prop_map(|(raw, codes, f)| {
        let (mode, fault, freshness, limits, (gain_set, age_cycles, control_word)) = codes;
        AxisRecord {
            mode,
            fault,
            gain_set,
            setpoint: Setpoint {
                position: Position::m(f[0]),
                velocity: Velocity::m_per_s(f[1]),
                acceleration: Acceleration::m_per_s2(f[2]),
            },
            sample: Sample {
                raw,
                freshness,
                age_cycles,
                position: Position::m(f[3]),
                velocity: Velocity::m_per_s(f[4]),
                table_position: Position::m(f[5]),
                current: Current::a(f[6]),
            },
            command: Command {
                current: Current::a(f[7]),
                control_word,
                terms: Terms {
                    following_error: Position::m(f[8]),
                    expected_position: Position::m(f[9]),
                    expected_velocity: Velocity::m_per_s(f[10]),
                    velocity_command: Velocity::m_per_s(f[11]),
                    proportional: Torque::nm(f[12]),
                    integral: Torque::nm(f[13]),
                    friction: Torque::nm(f[14]),
                    inertia: Torque::nm(f[15]),
                },
                limits,
            },
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_record_comes_back_bit_for_bit(record in any_record()) {
        let folder = folder();
        let path = folder.path().join("run.mcap");
        write_with(&path, record.axes.count(), 4, std::iter::once(record));
        let read: Vec<_> = Reader::open(&path).unwrap().map(Result::unwrap).collect();
        prop_assert_eq!(read.len(), 1);
        prop_assert!(is_same(&read[0], &record), "{:?} became {:?}", record, read[0]);
    }
}
