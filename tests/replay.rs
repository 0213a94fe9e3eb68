//! Promise: what a cycle was told, given again to today's code, gives the same records bit for bit; and
//! a log in which anything differs is refused by cycle and field.

mod common;
#[path = "common/eventful.rs"]
mod eventful;

use common::{X, machine};
use eventful::{Kept, eventful};
use quadrant::base::record::ModeTag;
use quadrant::log::schema::difference;
use quadrant::offline::replay::Replayer;
use quadrant::rt::door::Order;
use rstest::rstest;

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

#[rstest]
fn whatever_happened_comes_out_again_bit_for_bit(#[values("reference", "classic")] name: &str) {
    let (mut moved, mut faulted, mut told, mut late, mut repeated) = (0, 0, 0, 0, 0);
    for seed in 0..60 {
        let (kept, _) = eventful(name, seed);
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
    let (mut kept, _) = eventful("reference", 0);
    let at = kept.iter().position(|(record, _)| record.axes[X].mode == ModeTag::Moving).expect("it moves");
    let cycle = kept[at + 7].0.cycle;
    // The record tells of another encoder reading, but not of another position.
    kept[at + 7].0.axes[X].sample.raw.motor_counts ^= 4;
    assert_eq!(first_difference("reference", &kept), Some((cycle, "x.sample_position_m".to_owned())));
}

#[test]
fn a_missing_order_is_found_where_it_acts() {
    let (mut kept, _) = eventful("reference", 0);
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
