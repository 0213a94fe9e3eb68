//! What was recorded is what is read, and what others read.

use proptest::prelude::*;
use quadrant::base::axis::{AXES_MAX, PerAxis};
use quadrant::base::command::{Command, Limits, Terms};
use quadrant::base::fault::Fault;
use quadrant::base::record::{
    Arrival, Arrivals, AxisRecord, BusRecord, BusState, CycleRecord, LinkCounts, ModeTag, Refusal, Stage,
    Timing,
};
use quadrant::base::sample::{Freshness, RawFeedback, Sample};
use quadrant::base::setpoint::Setpoint;
use quadrant::base::time::Moment;
use quadrant::base::units::{Acceleration, Current, Position, Torque, Velocity};
use quadrant::log::{Reader, WriteOutcome};

use crate::example::{WALL_AT_ZERO_NS, folder, header, is_same, record, write, write_with};

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
    let timing = any::<[i64; 6]>().prop_map(|ns| {
        let [scheduled, awaited, woke, collected, decided, previous_finished] = ns.map(Moment::ns);
        Timing { scheduled, awaited, woke, collected, decided, previous_finished }
    });
    let stage = (any::<u32>(), any::<bool>()).prop_map(|(motion, is_measured)| Stage { motion, is_measured });
    let axes = (1..=AXES_MAX, proptest::array::uniform3(any_axis()));
    (any::<(u64, u64, u64)>(), timing, any_bus(), stage, axes).prop_map(
        |((cycle, overruns, lost_records), timing, bus, stage, (count, axes))| {
            let axes = PerAxis::from_fn(count, |axis| axes[axis.index()]);
            CycleRecord { cycle, timing, overruns, lost_records, bus, stage, axes }
        },
    )
}

fn any_bus() -> impl Strategy<Value = BusRecord> {
    use BusState::{BusOff, ErrorActive, ErrorPassive, ErrorWarning};
    let state = prop::sample::select(vec![ErrorActive, ErrorWarning, ErrorPassive, BusOff]);
    (state, any_refusal(), any::<[u32; 4]>()).prop_map(
        |(state, sync, [sent_crc, reports, foreign, dropped])| BusRecord {
            state,
            sync,
            sent_crc,
            reports,
            foreign,
            dropped,
        },
    )
}

fn any_refusal() -> impl Strategy<Value = Refusal> {
    prop::sample::select(vec![Refusal::None, Refusal::Full, Refusal::Down, Refusal::Unknown])
}

fn any_link() -> impl Strategy<Value = (Arrivals, LinkCounts)> {
    let arrival = || any::<(u8, i64)>().prop_map(|(place, at_ns)| Arrival { place, at: Moment::ns(at_ns) });
    let arrivals = (arrival(), arrival()).prop_map(|(motor, table)| Arrivals { motor, table });
    (arrivals, any::<[u32; 8]>()).prop_map(|(arrivals, counts)| {
        let [fresh, missed, late, repeated, malformed, heartbeats, emergencies, resets] = counts;
        let counts = LinkCounts { fresh, missed, late, repeated, malformed, heartbeats, emergencies, resets };
        (arrivals, counts)
    })
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
        any_refusal(),
    );
    (raw, any_link(), codes, proptest::array::uniform17(float())).prop_map(
        |(raw, (arrivals, link), codes, f)| {
            let (mode, fault, freshness, limits, (gain_set, age_cycles, control_word), refusal) = codes;
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
                arrivals,
                link,
                refusal,
                command: Command {
                    current: Current::a(f[7]),
                    control_word,
                    terms: Terms {
                        following_error: Position::m(f[8]),
                        expected_position: Position::m(f[9]),
                        expected_velocity: Velocity::m_per_s(f[10]),
                        velocity_command: Velocity::m_per_s(f[11]),
                        excitation: Velocity::m_per_s(f[12]),
                        proportional: Torque::nm(f[13]),
                        integral: Torque::nm(f[14]),
                        friction: Torque::nm(f[15]),
                        inertia: Torque::nm(f[16]),
                    },
                    limits,
                },
            }
        },
    )
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

#[test]
fn the_file_is_plain_mcap_with_both_times_on_the_wall_clock() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    write(&path, 2, 1000);
    let bytes = std::fs::read(&path).unwrap();
    let index = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(index.stats.as_ref().unwrap().message_count, 1000);
    assert_eq!((index.channels.len(), index.schemas.len()), (2, 2), "cycles and inputs");
    for (cycle, message) in mcap::MessageStream::new(&bytes).unwrap().enumerate() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!((message.channel.topic.as_str(), schema.name.as_str()), ("/cycle", "quadrant/msg/Cycle"));
        assert_eq!((message.channel.message_encoding.as_str(), schema.encoding.as_str()), ("cdr", "ros2msg"));
        let wall_ns = WALL_AT_ZERO_NS as u64 + cycle as u64 * 500_000;
        assert_eq!((message.log_time, message.publish_time), (wall_ns, wall_ns), "ns, cycle {cycle}");
    }
}

#[test]
fn a_run_without_a_cycle_is_a_whole_log() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    assert!(write(&path, 3, 0).is_complete);
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!(reader.header(), &header(3));
    assert!(reader.next().is_none());
    assert!(!reader.is_truncated());
}
