//! Promise: the frames we speak are those of `firmware-config/encoder-board.dbc`, on classic CAN those of
//! `encoder-board-classic.dbc`, signal by signal, in both directions.
//!
//! A DBC is parsed and applied bit by bit in f64 and integers, without any of our codec; the codec
//! is asked through its public functions. Values are random from a fixed seed, with the ends of each
//! range among them.

mod codec;
mod description;

use std::collections::BTreeSet;

use codec::{UA_PER_MA, Values, built, told};
use description::{address, bits, dbc, is_fd, random, read, write};
use quadrant::base::sample::RawFeedback;
use quadrant::base::units::Position;
use quadrant::rt::bus::{Format, Frame};
use quadrant::rt::drive::state::DriveState;
use quadrant::rt::wire::command::RawCommand;
use quadrant::rt::wire::scaling::{AxisScale, CurrentCounts, ScaleSettings, Sense};
use quadrant::rt::wire::{Address, Layout, Node, classic};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rstest::rstest;

const ROUNDS: usize = 2_000;

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn the_dbc_has_every_frame_of_the_codec_and_no_other(#[case] layout: Layout) {
    let described: BTreeSet<u32> = dbc(layout).messages.iter().map(|message| message.id.raw()).collect();
    let nodes = [1, 2].map(|number| Node::new(number).expect("a node number"));
    let spoken = nodes.into_iter().flat_map(|node| {
        let rare = [
            Address::Sync,
            Address::Emergency(node),
            Address::ParameterReply(node),
            Address::ParameterRequest(node),
            Address::Heartbeat(node),
        ];
        let feedback = layout.feedback(node, &RawFeedback::default());
        let cyclic = feedback.chain([layout.command(node, &RawCommand::default())]);
        rare.map(Address::id).into_iter().chain(cyclic.map(|frame| frame.id()))
    });
    assert_eq!(described, spoken.map(|id| u32::from(id.raw())).collect());
}

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn what_the_dbc_writes_the_codec_reads(#[case] layout: Layout) {
    let dbc = dbc(layout);
    let mut chance = Pcg64Mcg::seed_from_u64(1);
    for message in &dbc.messages {
        let fd = Format::Fd { bit_rate_switch: true };
        let format = if is_fd(&dbc, message) { fd } else { Format::Classic };
        for round in 0..ROUNDS {
            // Bits that belong to no signal are noise, which the codec must ignore.
            let mut payload: Vec<u8> = (0..message.size).map(|_| chance.random()).collect();
            let mut values = Values::new();
            for signal in &message.signals {
                let raw = random(&dbc, message, signal, &mut chance);
                write(signal, &mut payload, raw);
                values.insert(signal.name.clone(), raw);
            }
            if values.get("Specifier") == Some(&0x40) {
                values.remove("ObjectValue");
            }
            let frame = Frame::from_slice(address(message).id(), format, &payload).unwrap_or_else(|| {
                panic!("{}: {} bytes fit no {format:?} frame", message.name, message.size)
            });
            assert_eq!(
                told(layout, &frame),
                values,
                "{}, round {round}: codec left, DBC right",
                message.name
            );
        }
    }
}

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn what_the_codec_writes_the_dbc_reads(#[case] layout: Layout) {
    let dbc = dbc(layout);
    let mut chance = Pcg64Mcg::seed_from_u64(2);
    for message in &dbc.messages {
        let mut described_bits = vec![false; 8 * message.size as usize];
        for bit in message.signals.iter().flat_map(bits) {
            assert!(!std::mem::replace(&mut described_bits[bit], true), "{}: bit {bit} twice", message.name);
        }
        for round in 0..ROUNDS {
            let mut values: Values = (message.signals.iter())
                .map(|signal| (signal.name.clone(), random(&dbc, message, signal, &mut chance)))
                .collect();
            let frame = built(layout, address(message), &values);
            if values.get("Specifier") == Some(&0x40) {
                values.insert("ObjectValue".to_owned(), 0);
            }
            assert_eq!(frame.length(), message.size as usize, "{}: bytes", message.name);
            assert_eq!(frame.format() != Format::Classic, is_fd(&dbc, message), "{}: FD", message.name);
            let read: Values = (message.signals.iter())
                .map(|signal| (signal.name.clone(), read(signal, frame.payload())))
                .collect();
            assert_eq!(read, values, "{}, round {round}: DBC left, codec right", message.name);
            for (bit, _) in described_bits.iter().enumerate().filter(|(_, described)| !**described) {
                assert_eq!(
                    frame.payload()[bit / 8] >> (bit % 8) & 1,
                    0,
                    "{}: reserved bit {bit}",
                    message.name
                );
            }
        }
    }
}

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn quantities_of_the_dbc_are_those_of_the_scaling(#[case] layout: Layout) {
    let scale = AxisScale::new(&ScaleSettings {
        lead: Position::mm(10.0),
        motor_counts_per_rev: 1 << 20,
        motor_sense: Sense::Along,
        table_counts_per_mm: None,
        table_sense: Sense::Along,
    });
    let mut currents = 0;
    for signal in dbc(layout).messages.iter().flat_map(|message| &message.signals) {
        assert_eq!(signal.offset, 0.0, "{}", signal.name);
        match signal.unit.as_str() {
            "A" => {
                currents += 1;
                let ua_per_count = if signal.size == 16 { UA_PER_MA } else { 1 };
                let end = 1_i64 << (signal.size - 1);
                for counts in [-end, -1, 0, 1, 12_345, end - 1] {
                    let by_dbc = counts as f64 * signal.factor;
                    let ours = scale.current(CurrentCounts::ua((counts * ua_per_count) as i32)).as_a();
                    // Neither factor is a binary number: each product is off by a rounding.
                    let bound = by_dbc.abs() * f64::EPSILON;
                    assert!((ours - by_dbc).abs() <= bound, "{}: {ours} A, DBC {by_dbc} A", signal.name);
                }
            }
            "s" if signal.name == "BoardTime" => assert_eq!(signal.factor, 1e-6, "board time counts in us"),
            _ => assert_eq!(signal.factor, 1.0, "{}", signal.name),
        }
    }
    assert_eq!(currents, 4, "current signals of two nodes");
}

#[test]
fn the_drive_states_of_the_dbc_are_those_of_the_state_machine() {
    let dbc = dbc(Layout::Classic);
    let mut described = 0;
    for message in dbc.messages.iter().filter(|message| message.name.starts_with("FeedbackTable")) {
        let states = dbc.value_descriptions_for_signal(message.id, "DriveState").expect("states are listed");
        let named: Vec<(i64, String)> =
            states.iter().map(|state| (state.id, state.description.clone())).collect();
        let ours = classic::STATUS_WORDS.map(|word| {
            let name = format!("{:?}", DriveState::decode(word).expect("the word of a state"));
            name.chars().fold(String::new(), |text, c| {
                let gap = if c.is_uppercase() && !text.is_empty() { " " } else { "" };
                text + gap + &c.to_lowercase().to_string()
            })
        });
        assert_eq!(named, (0..).zip(ours).collect::<Vec<_>>(), "{}", message.name);
        described += 1;
    }
    assert_eq!(described, 2, "second frames of two nodes");
}
