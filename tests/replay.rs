//! Promise: what a cycle was told, given again to today's code, gives the same records bit for bit; and
//! a log in which anything differs is refused by cycle and field.

mod common;

use common::{Fate, Rig, X, Y, machine};
use quadrant::base::input::Input;
use quadrant::base::record::{BusState, CycleRecord, ModeTag};
use quadrant::log::schema::difference;
use quadrant::offline::replay::Replayer;
use quadrant::rt::bus::Id;
use quadrant::rt::door::Order;
use quadrant::rt::wire::scaling::TravelCounts;
use quadrant::rt::wire::{Address, command, controller};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rstest::rstest;

/// A run kept whole.
type Kept = Vec<(CycleRecord, Vec<Input>)>;

/// The first cycle and field that a replay gives differently.
fn first_difference(name: &str, kept: &Kept) -> Option<(u64, String)> {
    let machine = machine(name);
    let axes = machine.axis_names();
    let mut replayer = Replayer::new(&machine, &kept[0].1).expect("two boards");
    kept.iter().find_map(|(recorded, inputs)| {
        let replayed = replayer.run(recorded, inputs);
        difference(recorded, &replayed, &axes).map(|(field, ..)| (recorded.cycle, field))
    })
}

fn keep(rig: &mut Rig, kept: &mut Kept, cycles: usize) {
    for _ in 0..cycles {
        rig.step();
        kept.push((rig.last, rig.inputs.iter().copied().collect()));
    }
}

/// Two seconds of moves, gain changes, skipped periods and whatever can happen to frames and boards.
fn eventful(name: &str, seed: u64) -> Kept {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut rig = Rig::new(machine(name), seed);
    let mut frames = Pcg64Mcg::seed_from_u64(seed ^ 0xF00D);
    let trouble = [0.0, 0.002, 0.05][seed as usize % 3];
    rig.line.incoming = Box::new(move |frame| {
        if !frames.random_bool(trouble) {
            return Fate::Pass;
        }
        match frames.random_range(0..10) {
            0 | 1 => return Fate::Lost,
            7 => return Fate::Twice,
            8 => return Fate::Overtaken,
            9 => return Fate::Later([1, 2, 8, 256][frames.random_range(0..4)]),
            2 => *frame = frame.with_flipped_bit(frames.random_range(0..64)),
            3 => *frame = controller::encode(BusState::ErrorPassive),
            4 => *frame = quadrant::rt::bus::Frame::classic(Id::MAX, [1, 2, 3]),
            5 => *frame = quadrant::rt::bus::Frame::classic(frame.id(), [0; 8]),
            _ => *frame = if frames.random_bool(0.1) { command::encode_sync(9) } else { *frame },
        }
        Fate::Pass
    });
    let mut senders = Pcg64Mcg::seed_from_u64(seed ^ 0xCAFE);
    rig.line.outgoing = Box::new(move |frame| {
        let is_sync = Address::of(frame.id()) == Some(Address::Sync);
        match senders.random_range(0..if trouble > 0.0 && !is_sync { 4_000 } else { u32::MAX }) {
            0 => Fate::Refused,
            1 => Fate::Down,
            _ => Fate::Pass,
        }
    });
    let mut kept = Vec::new();
    for _ in 0..40 {
        match random.random_range(0..12) {
            0..4 => rig.order(Order::Enable),
            4 => rig.order(Order::Disable),
            5 => rig.order(Order::UseGains(random.random_range(0..3))),
            6 | 7 => rig.order(rig.line_to(random.random_range(-5.0..5.0), 80.0)),
            8 => rig.order(Order::ClearFaults),
            9 => rig.order(Order::Stop),
            10 => rig.skip(random.random_range(1..4)),
            _ if trouble > 0.01 => match random.random_range(0..4) {
                0 => rig.line.wired.rack_mut().board_mut(X).jump_encoder(TravelCounts::counts(100_000)),
                1 => rig.line.wired.rack_mut().board_mut(Y).trip_drive(0x2310, 7),
                2 => rig.line.wired.rack_mut().board_mut(Y).set_encoder_frozen(true),
                _ => rig.line.wired.rack_mut().board_mut(X).set_silent(random.random_bool(0.5)),
            },
            _ => {}
        }
        keep(&mut rig, &mut kept, 100);
    }
    kept
}

#[rstest]
fn whatever_happened_comes_out_again_bit_for_bit(#[values("reference", "classic")] name: &str) {
    let (mut moved, mut faulted, mut told, mut late, mut repeated) = (0, 0, 0, 0, 0);
    for seed in 0..60 {
        let kept = eventful(name, seed);
        assert_eq!(first_difference(name, &kept), None, "seed {seed}");
        let any = |mode: ModeTag| {
            kept.iter().any(|(record, _)| record.axes.as_slice().iter().any(|axis| axis.mode == mode))
        };
        moved += u32::from(any(ModeTag::Moving));
        faulted += u32::from(any(ModeTag::Faulted));
        told += kept.iter().map(|(_, inputs)| inputs.len()).sum::<usize>();
        let links = kept[kept.len() - 1].0.axes.map(|_, axis| axis.link);
        late += links.as_slice().iter().map(|link| link.late).sum::<u32>();
        repeated += links.as_slice().iter().map(|link| link.repeated).sum::<u32>();
    }
    assert!(late > 500 && repeated > 500, "{late} frames late, {repeated} repeated");
    assert!(moved >= 30 && faulted >= 15 && told > 5_000, "{moved} moved, {faulted} faulted, {told} inputs");
}

#[test]
fn a_changed_input_is_found_in_its_cycle() {
    let mut kept = eventful("reference", 0);
    let at = kept.iter().position(|(record, _)| record.axes[X].mode == ModeTag::Moving).expect("it moves");
    let cycle = kept[at + 7].0.cycle;
    // The record tells of another encoder reading, but not of another position.
    kept[at + 7].0.axes[X].sample.raw.motor_counts ^= 4;
    assert_eq!(first_difference("reference", &kept), Some((cycle, "x.sample_position_m".to_owned())));
}

#[test]
fn a_missing_order_is_found_where_it_acts() {
    let mut kept = eventful("reference", 0);
    let at = kept
        .iter()
        .position(|(_, inputs)| {
            inputs.iter().any(|input| matches!(input.what, quadrant::base::input::What::Order(Order::Enable)))
        })
        .expect("an order to enable");
    let cycle = kept[at].0.cycle;
    kept[at].1.clear();
    let (found, field) = first_difference("reference", &kept).expect("the axes are not enabled");
    assert_eq!((found, field.as_str()), (cycle, "x.control_word"));
}
