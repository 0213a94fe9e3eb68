//! A sample is fresh and true, or known to be old.

use quadrant::base::axis::AxisId;
use quadrant::base::input::Inputs;
use quadrant::base::sample::Freshness;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Current, Position};
use quadrant::rt::bus::faulty::Faults;
use quadrant::rt::bus::{Bus, Frame, Id, Received, SendError};
use quadrant::rt::drive::Observation;
use quadrant::rt::drive::state::Target;
use quadrant::rt::wire::command::RawCommand;
use quadrant::rt::wire::scaling::TravelCounts;
use quadrant::rt::wire::{Address, Layout, Node};
use rstest::rstest;

use crate::rig::*;

/// Position of an axis `cycle` periods after power, relative to the cycle it was first heard in.
fn true_position(axis: AxisId, cycle: u64, first: u64) -> Position {
    let travel = (cycle - first) as i64 * COUNTS_PER_PERIOD * (1 - 2 * axis.index() as i64);
    scale(axis).motor_position(TravelCounts::counts(travel))
}

#[rstest]
fn positions_start_at_zero_and_go_on_over_the_wrap(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    let first = rig.cycle + 1;
    for _ in 0..20 {
        let seen = rig.collect();
        for (axis, observation) in seen.iter() {
            let sample = observation.sample;
            assert_eq!(sample.freshness, Freshness::Fresh);
            assert_eq!(sample.position, true_position(axis, rig.cycle, first), "axis {axis}");
            assert!(sample.position >= Position::ZERO, "both axes move upwards, one counts backwards");
        }
    }
    let velocity = rig.seen[Y].sample.velocity;
    assert!((velocity.as_m_per_s() - 0.1).abs() < 1e-4, "{velocity}, expected 0.1 m/s within 0.0001 m/s");
    assert_eq!(rig.seen[X].sample.table_position, Position::m(19.0 * COUNTS_PER_PERIOD as f64 * 1e-8));
}

#[rstest]
#[case::drop(Faults { drop: 0.3, ..Faults::NONE })]
#[case::delay(Faults { delay: (0.3, Span::us(500)), ..Faults::NONE })]
#[case::long_delay(Faults { delay: (0.3, Span::us(3_500)), ..Faults::NONE })]
#[case::repeat(Faults { repeat: 0.5, ..Faults::NONE })]
#[case::reorder(Faults { reorder: 0.3, ..Faults::NONE })]
#[case::all(Faults { drop: 0.1, delay: (0.1, Span::us(1_000)), repeat: 0.1, reorder: 0.1, ..Faults::NONE })]
fn a_bad_bus_makes_samples_old_but_never_wrong(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
    #[case] faults: Faults,
) {
    let mut rig = Rig::new(layout, SHEET);
    let first = rig.cycle + 1;
    rig.collect();
    rig.wired.bus.set(faults, Faults { drop: faults.drop, ..Faults::NONE });
    let (mut stale, mut last) = ([0_u32; 2], rig.seen);
    for _ in 0..3_000 {
        let seen = rig.collect();
        for (axis, Observation { sample, .. }) in seen.iter() {
            match sample.freshness {
                Freshness::Fresh => {
                    assert_eq!(sample.position, true_position(axis, rig.cycle, first), "cycle {}", rig.cycle);
                    assert_eq!(sample.age_cycles, 0);
                }
                Freshness::Stale => {
                    stale[axis.index()] += 1;
                    assert_eq!(sample.age_cycles, last[axis].sample.age_cycles + 1, "ages by one a cycle");
                    assert_eq!(sample.raw, last[axis].sample.raw, "keeps the last values");
                    let heard = rig.cycle - u64::from(sample.age_cycles);
                    assert_eq!(
                        sample.position,
                        true_position(axis, heard, first),
                        "age tells when it was so"
                    );
                }
                Freshness::Never => panic!("axis {axis} was heard before"),
            }
            if rig.cycle > first {
                // One count in one period is 2e-5 m/s at 9.5 nm.
                let error_m_per_s = sample.velocity.as_m_per_s() - 0.1;
                assert!(
                    error_m_per_s.abs() < 1e-4 || sample.velocity.as_m_per_s() == 0.0,
                    "{error_m_per_s} m/s off"
                );
            }
        }
        last = seen;
    }
    let counts = rig.drives.link_counts();
    for (axis, counts) in counts.iter() {
        assert_eq!(counts.missed, stale[axis.index()], "axis {axis}");
        assert_eq!(counts.fresh + counts.missed, 3_001, "axis {axis}: every cycle is one or the other");
    }
    let happened = rig.wired.bus.counts().0;
    assert!(
        happened.dropped + happened.delayed + happened.repeated + happened.reordered > 300,
        "{happened:?}"
    );
    if faults.delay.0 > 0.2 {
        assert!(counts[X].late > 100, "{:?}", counts[X]);
    }
    if faults.repeat > 0.4 {
        assert!(counts[X].repeated > 100 && counts[X].missed == 0, "{:?}", counts[X]);
    }
}

#[rstest]
fn flipped_bits_are_survived_and_every_cycle_is_accounted_for(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    rig.wired.bus.set(Faults { flip_bit: 0.5, ..Faults::NONE }, Faults { flip_bit: 0.5, ..Faults::NONE });
    for _ in 0..3_000 {
        rig.collect();
        rig.dispatch(AMPERE, Target::Enabled);
    }
    let counts = rig.drives.link_counts()[X];
    assert_eq!(counts.fresh + counts.missed, 3_000);
    assert!(counts.late > 50, "a flipped cycle is an answer to another SYNC: {counts:?}");
}

#[rstest]
fn a_stale_sample_is_right_again_after_travel_of_nearly_half_the_range(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    let first = rig.cycle + 1;
    rig.collect();
    let gap = i64::from(i32::MAX) / COUNTS_PER_PERIOD;
    rig.cycle += gap as u64 - 1;
    let sample = rig.collect()[X].sample;
    assert_eq!(sample.position, true_position(X, first + gap as u64, first));
    let error_m_per_s = sample.velocity.as_m_per_s() - 0.1;
    assert!(error_m_per_s.abs() < 1e-4, "skipped periods count: {error_m_per_s} m/s off, bound 0.0001 m/s");
}

#[rstest]
fn before_the_first_answer_there_is_no_sample_and_waiting_has_an_age(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    rig.board(Y).set_silent(true);
    let seen = rig.run(9, Current::ZERO, Target::Disabled);
    assert_eq!((seen[Y].sample.freshness, seen[Y].sample.age_cycles), (Freshness::Never, 9));
    assert_eq!(seen[Y].drive, None);
    assert_eq!(seen[X].sample.freshness, Freshness::Fresh, "one silent board does not take the other along");
}

#[rstest]
fn frames_of_strangers_are_counted_and_change_nothing(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    let before = rig.collect();
    let stranger = Node::new(9).expect("a node number");
    for frame in [
        layout.command(stranger, &RawCommand::default()),
        Frame::classic(Address::Feedback(stranger).id(), [0; 8]),
        Frame::classic(Id::from_low_bits(0x000), [1, 0]),
    ] {
        rig.wired.machine.end.send(&frame).expect("room for a frame");
    }
    rig.wired
        .machine
        .end
        .send(&Frame::classic(Address::Feedback(node(X)).id(), [0; 7]))
        .expect("room for a frame");
    let seen = rig.collect();
    assert_eq!(rig.drives.bus().foreign, 3);
    assert_eq!(rig.drives.link_counts()[X].malformed, 1, "a feedback frame of 7 bytes");
    assert_eq!(seen[X].sample.raw.sequence, before[X].sample.raw.sequence + 1);
}

/// A bus on which a stranger never stops talking.
struct Flooded;

impl Bus for Flooded {
    fn send(&mut self, _: &Frame) -> Result<(), SendError> {
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        Some(Received { frame: Frame::classic(Id::MAX, []), at: until })
    }
}

#[rstest]
fn a_flooded_bus_cannot_hold_the_cycle(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut drives = Rig::new(layout, SHEET).drives;
    let mut inputs = Inputs::default();
    drives.collect(&mut Flooded, 1, Moment::ZERO, &mut inputs);
    assert_eq!(drives.observations()[X].sample.freshness, Freshness::Never);
    assert_eq!(drives.bus().foreign, 64, "32 frames an axis");
}

#[rstest]
fn a_sync_the_bus_refuses_is_reported_on_every_axis(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    rig.collect();
    let filler = Frame::classic(Id::MAX, []);
    while rig.wired.bus.send(&filler).is_ok() {}
    let seen = rig.collect();
    assert!(seen[X].events.is_sync_refused && seen[Y].events.is_sync_refused);
    assert_eq!(seen[X].sample.freshness, Freshness::Stale);
    assert!(!rig.collect()[X].events.is_sync_refused, "the bus has room again");
}
