//! Where a host goes another way, where something is missing, and when frames are sent on the wall clock.

use quadrant::base::input::{Input, What};
use quadrant::base::record::Timing as Clock;
use quadrant::base::sample::Freshness;
use quadrant::base::time::{Moment, Span};
use quadrant::offline::playback::{PlaybackError, Played, Timing};
use quadrant::offline::traffic::Frames;
use quadrant::rt::bus::lockstep::marker;
use quadrant::rt::bus::{Frame, Id, Received};
use quadrant::rt::wire::command::encode_sync;
use quadrant::rt::wire::parameter::{Access, Object, encode_request};
use quadrant::rt::wire::state::{Heartbeat, encode_heartbeat};

use crate::common::{X, machine};
use crate::eventful::eventful;
use crate::{Way, playback, played};

fn heard(frame: Frame, at: Moment) -> Received {
    Received { frame, at }
}

#[test]
fn a_host_that_goes_another_way_is_told_so() {
    let machine = machine("reference");
    let (kept, _) = eventful("reference", 0);
    let hear = |frames: &[Frame]| {
        let (mut playback, mut way) = (playback(&machine, &kept, Timing::AtOnce), Way::default());
        for frame in frames {
            playback.hear(&heard(*frame, Moment::ZERO), &mut way).expect("there is no board");
        }
        playback.fall_silent();
        playback.into_played()
    };
    let [first, second] = [0, 1].map(|cycle| {
        let record = &kept[cycle].0;
        [vec![encode_sync(record.cycle as u32)], Frames::of(&machine).commands(record)].concat()
    });
    let ended = |played: Played| played.ended_early.expect("it ended early");
    assert!(ended(hear(&[encode_sync(1)])).contains("SYNC of cycle 1, in the log that of cycle 0 is next"));
    let both = [&first[..], &second[..]].concat();
    assert!(ended(hear(&both)).starts_with("behind 1 cycles: the host fell silent"), "the last may come yet");
    assert!(ended(hear(&[&first[..], &[marker(0)]].concat())).contains("a new session"));

    let difference = |frames: &[Frame]| hear(frames).difference.expect("something differs");
    let missing = difference(&[&first[..2], &second[..]].concat());
    assert_eq!((missing.cycle, missing.axis.as_str(), missing.live.as_str()), (0, "y", "not sent"));
    let twice = difference(&[&first[..], &first[1..]].concat());
    assert_eq!((twice.axis.as_str(), twice.recorded.as_str(), twice.live.as_str()), ("x", "one", "two"));
    for (bit, field) in
        [(0, "current_ua"), (32, "control_word"), (48, "cycle"), (64, "sequence"), (72, "mode_of_operation")]
    {
        let mut frames = first.clone();
        frames[2] = frames[2].with_flipped_bit(bit);
        let found = difference(&frames);
        assert_eq!((found.cycle, found.axis.as_str(), found.field), (0, "y", field));
    }
    let mut frames = first.clone();
    frames[2] = frames[2].with_flipped_bit(80);
    assert_eq!(difference(&frames).field, "reserved bytes");
    frames[2] = Frame::classic(frames[2].id(), [0; 8]);
    assert_eq!((difference(&frames).field, difference(&frames).live.as_str()), ("command", "8 bytes"));
}

#[test]
fn what_is_missing_in_the_log_ends_it_without_a_difference() {
    let machine = machine("reference");
    let (mut kept, _) = eventful("reference", 0);
    kept.remove(1_000);
    let (played, _) = played(&machine, &machine, &kept);
    let before = kept[999].0.cycle;
    assert_eq!((played.cycles, played.difference), (1_000, None));
    assert_eq!(played.ended_early, Some(format!("1 records are missing after cycle {before}")));
}

#[test]
fn nothing_is_played_where_a_board_speaks() {
    let machine = machine("reference");
    let (kept, _) = eventful("reference", 0);
    let (mut playback, mut way) = (playback(&machine, &kept, Timing::AtOnce), Way::default());
    let node = machine.axes[X].node;
    let frame = encode_heartbeat(node, &Heartbeat::default());
    let report = Frame::report(Id::from_low_bits(0x088), [0; 8]);
    assert_eq!(playback.hear(&heard(report, Moment::ZERO), &mut way), Ok(()), "of the own controller");
    let refusal = playback.hear(&heard(frame, Moment::ZERO), &mut way);
    assert_eq!(refusal, Err(PlaybackError::Board { node }));
    assert!(way.0.is_empty());
}

#[test]
fn an_answer_that_only_a_late_host_met_is_not_played_in_lock_step() {
    let machine = machine("reference");
    let (mut kept, _) = eventful("reference", 0);
    kept.truncate(400);
    let (record, inputs) = &mut kept[150];
    let answer = Frames::of(&machine).received(record, &[])[0].frame;
    let at = record.timing.scheduled + machine.cycle.reply_window + Span::ns(1);
    record.axes[X].sample.freshness = Freshness::Stale;
    inputs.push(Input { cycle: record.cycle, what: What::Frame { place: 9, received: heard(answer, at) } });
    let (played, _) = played(&machine, &machine, &kept);
    assert_eq!((played.cycles, played.difference), (150, None));
    let why = played.ended_early.expect("it ended early");
    assert!(why.contains("met an answer from behind the reply window"), "{why}");
}

/// A host that gave up while it asked is not the last.
#[test]
fn each_host_that_asks_is_told_the_heartbeats_of_before() {
    let machine = machine("reference");
    let (kept, _) = eventful("reference", 0);
    let (mut playback, mut way) = (playback(&machine, &kept, Timing::AtOnce), Way::default());
    let request = encode_request(machine.axes[X].node, Object::Vendor.address(), Access::Read);
    for host in 0..2 {
        way.0.clear();
        for frame in [marker(0), request, request] {
            playback.hear(&heard(frame, Moment::ZERO), &mut way).expect("there is no board");
        }
        let said: Vec<u16> = way.0.iter().map(|frame| frame.id().raw()).collect();
        assert_eq!(said, [0x07E, 0x701, 0x702, 0x581, 0x581], "host {host}");
    }
}

/// Frames that are due on the wall clock come as long after SYNC as they came in the log.
#[test]
fn on_the_wall_clock_each_frame_keeps_its_distance_from_sync() {
    let machine = machine("reference");
    let (mut kept, _) = eventful("reference", 0);
    kept.truncate(400);
    let us = |us: i64| Span::us(us);
    for (record, inputs) in &mut kept {
        let woke = record.timing.scheduled + us(20);
        record.timing = Clock { scheduled: record.timing.scheduled, ..Clock::at(woke) };
        for (axis, row) in record.axes.iter_mut() {
            row.arrivals.motor.at = woke + us(130 + 10 * axis.index() as i64);
            row.arrivals.table.at = row.arrivals.motor.at;
        }
        // A heartbeat from between two cycles.
        for input in inputs {
            if let What::Frame { received, .. } = &mut input.what {
                received.at = woke - us(70);
            }
        }
    }
    let is_heartbeat = |frame: &Frame| frame.id().raw() & 0x780 == 0x700;
    let has_beat = |(_, inputs): &(_, Vec<Input>)| {
        inputs
            .iter()
            .any(|input| matches!(input.what, What::Frame { received, .. } if is_heartbeat(&received.frame)))
    };
    let beats: Vec<usize> = (1..kept.len()).filter(|place| has_beat(&kept[*place])).collect();
    assert!(beats.len() > 1, "{} cycles with a heartbeat from before", beats.len());
    let frames = Frames::of(&machine);
    let (mut playback, mut way) = (playback(&machine, &kept, Timing::AsRecorded), Way::default());
    let mut beaten = Vec::new();
    for (place, (record, _)) in kept.iter().enumerate() {
        // This host is late by 7 us more than the recorded one.
        let sync = record.timing.woke + us(7);
        playback.hear(&heard(encode_sync(record.cycle as u32), sync), &mut way).expect("there is no board");
        for command in frames.commands(record) {
            playback.hear(&heard(command, sync), &mut way).expect("there is no board");
        }
        let before = way.0.len();
        while let Some(due) = playback.due() {
            way.0.clear();
            playback.speak(due - Span::ns(1), &mut way);
            assert!(way.0.is_empty(), "cycle {}: too early", record.cycle);
            playback.speak(due, &mut way);
            let offset = (due - sync).as_us();
            for frame in &way.0 {
                if is_heartbeat(frame) {
                    assert!((offset - 430.0).abs() < 1e-9, "cycle {}: {offset} us", record.cycle);
                    beaten.push(place + 1);
                } else {
                    let node = f64::from(frame.id().raw() & 0x7F);
                    assert!(
                        (offset - 120.0 - 10.0 * node).abs() < 1e-9,
                        "cycle {}: {offset} us",
                        record.cycle
                    );
                }
            }
        }
        assert_eq!(before, 0, "nothing was due at SYNC itself");
        way.0.clear();
    }
    beaten.dedup();
    assert_eq!(beaten, beats);
    let played = playback.into_played();
    assert_eq!((played.cycles, played.difference, played.ended_early), (400, None, None));
}
