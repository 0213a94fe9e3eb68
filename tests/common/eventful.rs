//! Runs in which much happens, kept whole.

use quadrant::base::input::Input;
use quadrant::base::record::{BusState, CycleRecord};
use quadrant::base::time::Span;
use quadrant::rt::bus::{Frame, Id};
use quadrant::rt::door::Order;
use quadrant::rt::wire::scaling::TravelCounts;
use quadrant::rt::wire::{Address, command, controller};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::common::{Fate, Rig, X, Y, machine};

/// Records, and what each cycle was told.
pub(crate) type Kept = Vec<(CycleRecord, Vec<Input>)>;

fn keep(rig: &mut Rig, kept: &mut Kept, cycles: usize) {
    for _ in 0..cycles {
        rig.step();
        kept.push((rig.last, rig.inputs.iter().copied().collect()));
    }
}

/// Moves, gain changes, skipped periods and whatever can happen to frames and boards, for 4000 cycles; and every
/// frame that the host sent or received.
pub(crate) fn eventful(name: &str, seed: u64) -> (Kept, Vec<Frame>) {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut rig = Rig::new(machine(name), seed);
    rig.line.crossed = Some(Vec::new());
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
            4 => *frame = Frame::classic(Id::MAX, [1, 2, 3]),
            5 => *frame = Frame::classic(frame.id(), [0; 8]),
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
        match random.random_range(0..13) {
            0..4 => rig.order(Order::Enable),
            4 => rig.order(Order::Disable),
            5 => rig.order(Order::UseGains(random.random_range(0..3))),
            6 | 7 => rig.order(rig.line_to(random.random_range(-5.0..5.0), 80.0)),
            8 => rig.order(Order::ClearFaults),
            9 => rig.order(Order::Stop),
            10 => rig.skip(random.random_range(1..4)),
            11 => {
                let mut motion = rig.excited_to(random.random_range(-6.0..6.0), 20.0);
                motion.excitation.period = Span::ms(20);
                motion.excitation.lines = 3;
                motion.excitation.harmonic_max = 6;
                rig.order(Order::Excited(motion));
            }
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
    (kept, rig.line.crossed.take().expect("it was asked for"))
}
