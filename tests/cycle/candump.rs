//! Promise: a log and the text of candump tell the same of a bus. What a log is exported to is what a listener
//! at the host's end of the bus wrote, frame for frame, whatever happened; and such a text becomes a log with the
//! same samples and commands, to the bit.

use std::fmt::Write;

use quadrant::base::input::{Input, Inputs, What};
use quadrant::base::record::{CycleRecord, ModeTag, Refusal};
use quadrant::offline::traffic::Frames;
use quadrant::offline::traffic::export::Export;
use quadrant::offline::traffic::import::{Import, ImportError, Imported, Wanted};
use quadrant::rt::bus::{Format, Frame};
use quadrant::rt::door::Records;
use rstest::rstest;

use crate::common::{X, Y, machine};
use crate::eventful::{Kept, eventful};

const WALL_AT_ZERO_NS: i64 = 1_800_000_000_123_456_789;

/// A frame as candump writes it, without the code under test.
fn text(frame: &Frame) -> String {
    let id = frame.id().raw();
    let mut text = match frame.format() {
        Format::Classic => format!("{id:03X}#"),
        Format::Fd { bit_rate_switch: true } => format!("{id:03X}##5"),
        Format::Fd { bit_rate_switch: false } => format!("{id:03X}##4"),
        Format::Report => format!("{:08X}#", 0x2000_0000 + u32::from(id)),
    };
    for byte in frame.payload() {
        let _infallible = write!(text, "{byte:02X}");
    }
    text
}

fn exported(name: &str, kept: &Kept) -> String {
    let mut text = Vec::new();
    let mut export = Export::new(&machine(name), WALL_AT_ZERO_NS, "can7", &mut text);
    for (record, inputs) in kept {
        export.cycle(record, inputs).expect("memory takes it");
    }
    String::from_utf8(text).expect("ASCII")
}

#[rstest]
fn an_export_is_what_a_listener_wrote(#[values("reference", "classic")] name: &str) {
    let (mut refused, mut reports) = (0, 0);
    for seed in 0..12 {
        let (kept, crossed) = eventful(name, seed);
        let exported = exported(name, &kept);
        // What commissioning left to the first cycle was heard before it.
        let heard = kept[0].1.iter().filter(|input| matches!(input.what, What::Before(_))).count();
        let frames: Vec<&str> =
            exported.lines().skip(heard).filter_map(|line| line.split(' ').nth(2)).collect();
        assert_eq!(frames.len(), crossed.len(), "seed {seed}: frames");
        for (place, (line, frame)) in frames.iter().zip(&crossed).enumerate() {
            assert_eq!(*line, text(frame), "seed {seed}: frame {place} of the text");
        }
        let commands = 2 * kept.len();
        let sent = crossed.iter().filter(|frame| frame.id().raw() & 0x780 == 0x200).count();
        refused += commands.saturating_sub(sent);
        reports += crossed.iter().filter(|frame| frame.format() == Format::Report).count();
    }
    assert!(refused > 5 && reports > 100, "{refused} commands refused, {reports} reports");
}

/// Records and inputs as they come.
#[derive(Default)]
struct Taken(Kept);

impl Records for Taken {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        self.0.push((*record, inputs.iter().copied().collect()));
    }
    fn lost(&self) -> u64 {
        0
    }
}

fn imported(name: &str, text: &str, wanted: &Wanted) -> Result<(Imported, Kept), ImportError> {
    let mut taken = Taken::default();
    let told = Import::begin(&machine(name), text.as_bytes(), wanted)?.run(&mut taken)?;
    Ok((told, taken.0))
}

/// Frames and orders of a cycle; heartbeats from before the run without their time, which is not told.
fn frames_of(inputs: &[Input]) -> Vec<What> {
    let told = inputs.iter().map(|input| match input.what {
        What::Before(mut received) => {
            received.at = quadrant::base::time::Moment::ZERO;
            What::Before(received)
        }
        other => other,
    });
    told.filter(|what| !matches!(what, What::Order(_))).collect()
}

#[rstest]
fn an_export_becomes_a_log_with_the_same_samples_and_commands(#[values("reference", "classic")] name: &str) {
    let frames = Frames::of(&machine(name));
    let (mut skipped, mut refused, mut stale) = (0, 0, 0);
    for seed in 0..12 {
        let (kept, _) = eventful(name, seed);
        let text = exported(name, &kept);
        let (told, again) = imported(name, &text, &Wanted::default()).expect("it is a text of candump");
        assert_eq!(again.len(), kept.len(), "seed {seed}: cycles");
        let mut missing = 0;
        for ((record, inputs), (was, told_then)) in again.iter().zip(&kept) {
            let at = format!("seed {seed}, cycle {}", was.cycle);
            assert_eq!((record.cycle, record.overruns), (was.cycle, was.overruns), "{at}");
            assert_eq!(
                (record.timing.woke, record.timing.scheduled),
                (was.timing.woke, was.timing.scheduled)
            );
            assert_eq!((record.bus.state, record.bus.reports), (was.bus.state, was.bus.reports), "{at}");
            assert_eq!(record.bus.foreign, was.bus.foreign, "{at}");
            for (axis, row) in record.axes.iter() {
                let was = &was.axes[axis];
                // As text, because a missing table scale is not a number.
                assert_eq!(format!("{:?}", row.sample), format!("{:?}", was.sample), "{at}, {axis}");
                assert_eq!((row.arrivals, row.link), (was.arrivals, was.link), "{at}, {axis}");
                assert_eq!(row.mode, ModeTag::Unknown);
                assert!(!row.setpoint.is_finite() && row.command.terms.integral.as_nm().is_nan());
                let is_told = was.refusal == Refusal::None;
                assert_eq!(
                    row.refusal,
                    if is_told { Refusal::None } else { Refusal::Unknown },
                    "{at}, {axis}"
                );
                missing += u64::from(!is_told);
                stale += u32::from(row.sample.age_cycles > 0);
            }
            assert_eq!(frames.commands(record), frames.commands(was), "{at}");
            assert_eq!(frames_of(inputs), frames_of(told_then), "{at}");
            if was.commands() == Refusal::None {
                assert_eq!(record.bus.sent_crc, was.bus.sent_crc, "{at}");
            }
        }
        assert_eq!((told.cycles, told.commands_missing), (kept.len() as u64, missing), "seed {seed}");
        assert_eq!((told.cycles_missing, told.sequence_breaks), (0, 0), "seed {seed}");
        assert_eq!(told.periods_skipped, kept[kept.len() - 1].0.overruns, "seed {seed}");
        assert_eq!(exported(name, &again), text, "seed {seed}: exported again");
        skipped += told.periods_skipped;
        refused += missing;
    }
    assert!(
        skipped > 20 && refused > 5 && stale > 1_000,
        "{skipped} skipped, {refused} refused, {stale} stale"
    );
}

/// 600 cycles in which nothing happens but orders, as lines.
fn quiet() -> Vec<String> {
    let (mut kept, _) = eventful("reference", 0);
    kept.truncate(600);
    exported("reference", &kept).lines().map(str::to_owned).collect()
}

fn text_of(lines: &[String]) -> String {
    lines.join("\n") + "\n"
}

/// The line of a cycle's SYNC.
fn sync_at(lines: &[String], cycle: u32) -> usize {
    let sync: String = cycle.to_le_bytes().iter().map(|byte| format!("{byte:02X}")).collect();
    lines.iter().position(|line| line.ends_with(&format!(" 080#{sync}"))).expect("its SYNC")
}

#[track_caller]
fn taken(lines: &[String]) -> (Imported, Kept) {
    imported("reference", &text_of(lines), &Wanted::default()).expect("it is a text of candump")
}

#[test]
fn what_a_text_lacks_is_counted_where_it_is_lacking() {
    let whole = quiet();
    let (told, kept) = taken(&whole);
    assert!(told.is_whole() && told.periods_skipped > 0, "{told:?}");

    // The listener was away for ten cycles; the samples behind are those of a host that missed ten.
    let mut lines = whole.clone();
    lines.drain(sync_at(&whole, 350)..sync_at(&whole, 360));
    let (paused, after) = taken(&lines);
    assert_eq!((paused.cycles, paused.cycles_missing), (told.cycles - 10, 10));
    assert_eq!(paused.periods_skipped, told.periods_skipped, "they were not skipped");
    assert!(!paused.is_whole());
    let at = |kept: &Kept, cycle| kept.iter().find(|(record, _)| record.cycle == cycle).expect("a record").0;
    let (was, is) = (at(&kept, 360), at(&after, 360));
    assert_eq!(is.axes[X].sample.position, was.axes[X].sample.position);
    assert_eq!((is.overruns, is.axes[X].sample.age_cycles), (was.overruns, 0));

    // A feedback and a command that nobody saw.
    let mut lines = whole.clone();
    let (sync, next) = (sync_at(&whole, 400), sync_at(&whole, 401));
    let feedback = (sync..next).find(|at| lines[*at].contains(" 181#")).expect("feedback of X");
    let command = (sync..next).find(|at| lines[*at].contains(" 202#")).expect("a command to Y");
    lines.remove(command);
    lines.remove(feedback);
    let (told, after) = taken(&lines);
    assert_eq!((told.commands_missing, told.cycles_missing, told.sequence_breaks), (1, 0, 0));
    let record = at(&after, 400);
    assert_eq!((record.axes[X].sample.age_cycles, record.axes[Y].sample.age_cycles), (1, 0));
    assert_eq!(record.axes[Y].refusal, Refusal::Unknown);
    assert!(record.axes[Y].command.current.as_a().is_nan());

    // A stranger's commands and SYNCs, and what the listener says of itself.
    let stranger = whole[command].replace(" 202#", " 201#");
    let said = "DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)".to_owned();
    let syncs: Vec<String> = whole.iter().filter(|line| line.contains(" 080#")).take(3).cloned().collect();
    let mut lines = [&whole[..=command], &[stranger, said], &whole[command + 1..]].concat();
    for (place, sync) in syncs.iter().enumerate() {
        lines.insert(sync_at(&lines, 500 + place as u32) + 1, sync.clone());
    }
    let (told, after) = taken(&lines);
    assert_eq!((told.syncs_aside, told.commands_aside, told.left_out.dropped), (3, 1, 3));
    assert_eq!((told.left_out.times_back, told.another_run_at_line), (3, None));
    assert_eq!((told.cycles, at(&after, 599).bus.dropped), (kept.len() as u64, 3));
}

/// The next run begins with its commissioning and the SYNC of cycle 0.
#[test]
fn an_import_ends_where_another_run_begins() {
    let whole = quiet();
    let (_, kept) = taken(&whole);
    let lines = [&whole[..], &whole[..]].concat();
    let (told, again) = taken(&lines);
    let line = (whole.len() + sync_at(&whole, 0) + 1) as u64;
    assert_eq!((told.another_run_at_line, told.is_whole()), (Some(line), false));
    assert_eq!((told.cycles, again.len()), (kept.len() as u64, kept.len()));
    // In lock step already with the marker that begins the session.
    let session = [&["(1800000000.000000) can7 07E#00000000".to_owned()], &whole[..]].concat();
    let (told, again) = taken(&[&session[..], &session[..]].concat());
    assert_eq!(told.another_run_at_line, Some(session.len() as u64 + 1));
    assert_eq!(again.len(), kept.len());
}

#[test]
fn feedback_behind_the_reply_window_is_late_as_it_was_live() {
    let whole = quiet();
    let (sync, next) = (sync_at(&whole, 400), sync_at(&whole, 401));
    let feedback = (sync..next).find(|at| whole[*at].contains(" 181#")).expect("feedback of X");
    let stamp = |line: &str, us: u64| {
        let at: u64 = line[1..18].replace('.', "").parse().expect("a time");
        let at = at + us;
        format!("({:010}.{:06}){}", at / 1_000_000, at % 1_000_000, &line[19..])
    };
    // Commands wait for the end of the window at 300 us, so it comes behind them.
    for (us, stale) in [(0, 0), (1, 1)] {
        let mut lines = whole.clone();
        let late = stamp(&lines.remove(feedback), us);
        lines.insert(next - 1, late);
        let (told, after) = taken(&lines);
        assert!(told.is_whole());
        let record = |cycle| after.iter().find(|(record, _)| record.cycle == cycle).expect("a record").0;
        let x = record(400).axes[X];
        assert_eq!(x.sample.age_cycles, stale, "{} us behind the window", us);
        let late = record(401).axes[X].link.late - x.link.late;
        assert_eq!(late, stale, "late in the cycle behind it");
    }
}

#[test]
fn a_text_that_begins_within_a_run_begins_with_its_first_sync() {
    let whole = quiet();
    let cut = &whole[sync_at(&whole, 350) - 3..];
    let (told, after) = taken(cut);
    let (_, kept) = taken(&whole);
    assert_eq!((told.frames_before, told.cycles_missing, after[0].0.cycle), (3, 0, 350));
    let (was, is) = (kept[kept.len() - 1].0, after[after.len() - 1].0);
    assert_eq!(is.timing, was.timing, "moments of the run");
    let way = |kept: &Kept| {
        let position = |at: usize| kept[at].0.axes[X].sample.position.as_um();
        position(kept.len() - 1) - position(kept.len() - after.len())
    };
    // Positions count from the first sample, so it is the way that is the same.
    assert!((way(&after) - way(&kept)).abs() < 1e-6, "{} um, {} um", way(&after), way(&kept));
}

#[test]
fn what_is_no_text_of_this_bus_is_refused_with_its_line_or_left_out_when_asked() {
    let whole = quiet();
    let refused = |lines: &[String], wanted: &Wanted| {
        imported("reference", &text_of(lines), wanted).map(drop).expect_err("refused").to_string()
    };
    let with = |at: usize, line: &str| {
        let mut lines = whole.clone();
        lines.insert(at, line.to_owned());
        lines
    };
    let plain = Wanted::default();
    for (line, says) in [
        ("(1735270496.916858) can0 18", "line 701: `18` is no frame"),
        ("nonsense", "line 701: `nonsense` is no time"),
        ("(1800000000.400000) can1 181#00", "line 701: interface can1 beside can7"),
        ("(1800000000.400000) can7 080#", "line 701: frame has 0 bytes, expected 4"),
    ] {
        let said = refused(&with(700, line), &plain);
        assert!(said.starts_with(says), "`{said}`");
    }
    let none: Vec<String> = whole.iter().filter(|line| !line.contains(" 080#")).cloned().collect();
    assert!(refused(&none, &plain).starts_with("none of the "), "{}", refused(&none, &plain));

    let (_, kept) = taken(&whole);
    let mut lines = with(700, "(1735270496.916858) can0 18");
    lines.insert(900, "(1800000000.400000) can1 181##5FF".to_owned());
    let wanted = Wanted { interface: Some("can7".to_owned()), skips_damaged: true };
    let (told, again) = imported("reference", &text_of(&lines), &wanted).expect("the rest is right");
    assert_eq!((told.left_out.damaged_lines, told.left_out.of_other_interfaces), (1, 1));
    assert!(told.left_out.first_damage.is_some_and(|damage| damage.starts_with("line 701: `18`")));
    assert_eq!(format!("{again:?}"), format!("{kept:?}"));
}

/// In lock step the listener's times say nothing of the machine.
#[test]
fn markers_put_the_cycles_on_the_grid() {
    let whole = quiet();
    let (_, kept) = taken(&whole);
    // As slow as two programs may be, with a marker behind each SYNC and one behind the answers.
    let mut lines = vec!["(1800000000.000000) can7 07E#00000000".to_owned()];
    for (number, line) in whole.iter().enumerate() {
        let frame = line.split(' ').nth(2).expect("a frame");
        let stamp = |ms: usize| format!("({}.{:03}000) can7", 1_800_000_000 + ms / 1_000, ms % 1_000);
        if frame.starts_with("201#") {
            lines.push(format!("{} 07E#{:08X}", stamp(7 * number), number));
        }
        lines.push(format!("{} {frame}", stamp(7 * number + 1)));
        if frame.starts_with("080#") {
            lines.push(format!("{} 07E#{:08X}", stamp(7 * number + 2), number + 1));
        }
    }
    let (told, again) = taken(&lines);
    assert!(told.is_whole(), "{told:?}");
    for ((record, inputs), (was, told_then)) in again.iter().zip(&kept) {
        assert_eq!(record.timing.scheduled, was.timing.scheduled);
        for (axis, row) in record.axes.iter() {
            assert_eq!((&row.sample, row.link), (&was.axes[axis].sample, was.axes[axis].link));
        }
        assert_eq!(frames_of(inputs), frames_of(told_then));
    }
}
