//! Promise: a position that jumps further than a motor can move is found in the cycle in which it comes, and
//! what stays unseen is no larger than docs/faults/11-encoder-jump.md says. No machine that is sound shows
//! one: not at the drive's peak current, not with lost samples, not with a coarse encoder. Nor is a sound
//! encoder ever taken for one that stands.

use quadrant::base::fault::Fault;
use quadrant::base::record::ModeTag;
use quadrant::base::units::Position;
use quadrant::config::Machine;
use quadrant::rt::wire::scaling::{CurrentCounts, TravelCounts};
use quadrant::rt::wire::{Address, Node};

use crate::common::{self, Fate, Rig, X, machine_with};

/// Machines, each with the line that says how fine its encoders are.
const MACHINES: [(&str, &str); 3] = [
    ("reference", "counts-per-rev = 1048576"),
    ("paper", "counts-per-rev = 268435456"),
    ("classic", "counts-per-rev = 1048576"),
];

/// The faults of X after a jump at this speed: in the next cycle, and three later.
fn fault_after(machine: &str, speed_mm_per_s: f64, jump_um: f64) -> (Option<Fault>, Option<Fault>) {
    let mut rig = Rig::new(common::machine(machine), 5);
    rig.run(20);
    rig.enable();
    if speed_mm_per_s > 0.0 {
        let order = rig.line_to(200.0, speed_mm_per_s);
        rig.order(order);
        rig.run(1_500);
        assert_eq!(rig.axis(X).mode, ModeTag::Moving);
    }
    let per_um = rig.machine.axes[X].scale.motor_counts(Position::mm(1.0));
    let counts = (jump_um * per_um.as_counts() as f64 / 1e3).round();
    rig.line.wired.rack_mut().board_mut(X).jump_encoder(TravelCounts::counts(counts as i64));
    rig.step();
    let at_once = rig.axis(X).fault;
    rig.run(3);
    (at_once, rig.axis(X).fault)
}

#[test]
fn a_jump_is_found_in_the_cycle_in_which_it_comes() {
    // (machine, um at rest that are just found, um at 100 mm/s that are found for certain)
    for (machine, at_rest_um, moving_um) in
        [("reference", 4.0, 5.7), ("paper", 4.0, 5.7), ("classic", 15.7, 22.1)]
    {
        for sign in [-1.0, 1.0] {
            for (speed, um) in [(0.0, at_rest_um), (100.0, moving_um), (100.0, 20.0), (100.0, 600.0)] {
                let (at_once, _) = fault_after(machine, speed, sign * um);
                let case = format!("{machine}: {} um at {speed} mm/s", sign * um);
                assert_eq!(at_once, Some(Fault::EncoderJump), "{case}");
            }
            // What a motor could do is not held against it.
            let (_, later) = fault_after(machine, 0.0, sign * (at_rest_um - 0.3));
            assert_eq!(later, None, "{machine}: {} um at rest", sign * (at_rest_um - 0.3));
        }
    }
}

/// Lines of a machine file replaced.
type Edits = &'static [(&'static str, &'static str)];

const SOUND: [(&str, Edits); 7] = [
    ("as it is", &[]),
    ("half the mass", &[("mass-kg = 335.0", "mass-kg = 167.5")]),
    ("three times the mass", &[("mass-kg = 335.0", "mass-kg = 1005.0")]),
    (
        "no friction",
        &[("breakaway-n = 1127.8", "breakaway-n = 1.0"), ("sliding-n = 951.3", "sliding-n = 1.0")],
    ),
    (
        "twice the friction",
        &[("breakaway-n = 1127.8", "breakaway-n = 2255.6"), ("sliding-n = 951.3", "sliding-n = 1902.6")],
    ),
    ("200 um of backlash", &[("backlash-um = 0.0", "backlash-um = 200.0")]),
    (
        "200 um of backlash under three times the mass",
        &[("backlash-um = 0.0", "backlash-um = 200.0"), ("mass-kg = 335.0", "mass-kg = 1005.0")],
    ),
];

/// Thrown to and fro by its drive at peak current, whatever the host says. The host has the axis off, where
/// nothing but a jump is a fault.
fn thrown(rig: &mut Rig, every: u64) {
    let layout = rig.machine.bus.layout;
    let mut count = 0;
    rig.line.outgoing = Box::new(move |frame| {
        let node = Node::new(1).expect("a node");
        if Address::of(frame.id()) == Some(Address::Command(node)) {
            let mut raw = layout.decode_command(frame).expect("the host sends whole commands");
            raw.control_word = [0x06, 0x07, 0x0F][count.min(8) as usize / 4];
            let sign = if (count / every).is_multiple_of(2) { 1 } else { -1 };
            raw.current = CurrentCounts::ua(25_000_000 * sign);
            count += 1;
            *frame = layout.command(node, &raw);
        }
        Fate::Pass
    });
}

#[test]
fn no_sound_axis_jumps_however_its_drive_throws_it() {
    for (machine, fine) in MACHINES {
        for (what, edits) in SOUND {
            for encoder in [fine, "counts-per-rev = 10000"] {
                let edits: Vec<_> = edits.iter().copied().chain([(fine, encoder)]).collect();
                for every in [1, 3, 8, 20, 60, 150] {
                    stays_sound(
                        &format!("{machine}, {what}, {encoder}"),
                        machine_with(machine, &edits),
                        every,
                    );
                }
            }
        }
    }
}

fn stays_sound(name: &str, machine: Machine, every: u64) {
    let mut rig = Rig::new(machine, 3);
    rig.run(5);
    thrown(&mut rig, every);
    let mut fastest_mm_per_s = 0.0_f64;
    for cycle in 0..2_400_u64 {
        // Then two samples are lost now and again, and the host is late by two periods.
        let is_lost = cycle % 37 < 2 && cycle > 1_200;
        rig.line.incoming = Box::new(move |frame| match Address::of(frame.id()) {
            Some(Address::Feedback(_)) if is_lost => Fate::Lost,
            _ => Fate::Pass,
        });
        if cycle % 101 == 100 {
            rig.skip(2);
        }
        rig.step();
        assert_eq!(rig.axis(X).fault, None, "{name}, thrown each {every} cycles: cycle {cycle}");
        fastest_mm_per_s = fastest_mm_per_s.max(rig.state(X).motor_velocity.abs().as_mm_per_s());
    }
    assert!(fastest_mm_per_s > every.min(20) as f64, "{name}: {fastest_mm_per_s} mm/s, it was not thrown");
}

#[test]
fn no_sound_encoder_is_taken_for_one_that_stands() {
    for (machine, fine) in MACHINES {
        for (what, edits) in SOUND {
            // The second is as coarse as can be judged: eight counts are what 2 A wind up.
            for encoder in [fine, "counts-per-rev = 11000", "counts-per-rev = 40000"] {
                let edits: Vec<_> = edits.iter().copied().chain([(fine, encoder)]).collect();
                let mut rig = Rig::new(machine_with(machine, &edits), 3);
                rig.enable();
                // Fast, hardly at all, and standing while the integral winds the screw up.
                for (place_mm, speed_mm_per_s) in
                    [(20.0, 100.0), (19.9, 0.3), (20.0, 2.0), (20.0, 2.0), (0.0, 150.0)]
                {
                    let order = rig.line_to(place_mm, speed_mm_per_s);
                    rig.order(order);
                    for _ in 0..2_000 {
                        rig.step();
                        assert_eq!(rig.axis(X).fault, None, "{machine}, {what}, {encoder}: to {place_mm} mm");
                    }
                }
                assert!(rig.state(X).motor_position.as_mm().abs() < 15.0, "{machine}: it has not moved");
            }
        }
    }
}
