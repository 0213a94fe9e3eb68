//! Promise: what a cycle was told, given again to today's code, gives the same records bit for bit;
//! a log in which anything differs is refused by cycle and field; and one in which something is missing ends
//! there, with what is missing, and not with a difference.

use std::path::{Path, PathBuf};
use std::time::Duration;

use quadrant::base::input::{Input, Inputs, What};
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::time::Moment;
use quadrant::base::units::Velocity;
use quadrant::log::schema::difference;
use quadrant::log::{Pace, Reader, Writer, recover};
use quadrant::offline::recorded::{RecordedCycle, StartError};
use quadrant::offline::replay::{Replay, ReplayError, Replayer, replay, replay_cycles};
use quadrant::rt::door::{Order, Records, record_ring};
use quadrant::run::{Origin, Place, header};
use quadrant::sim::closed_loop::Patient;
use rstest::rstest;

use crate::common::{X, machine};
use crate::eventful::{Kept, eventful};

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
    let (mut moved, mut faulted, mut told, mut late, mut repeated, mut excited) = (0, 0, 0, 0, 0, 0);
    for seed in 0..60 {
        let (kept, _) = eventful(name, seed);
        assert_eq!(first_difference(name, &kept), None, "seed {seed}");
        let any = |mode: ModeTag| {
            kept.iter().any(|(record, _)| record.axes.as_slice().iter().any(|axis| axis.mode == mode))
        };
        moved += u32::from(any(ModeTag::Moving));
        faulted += u32::from(any(ModeTag::Faulted));
        told += kept.iter().map(|(_, inputs)| inputs.len()).sum::<usize>();
        let is_excited =
            |(record, _): &&(CycleRecord, _)| record.axes[X].command.terms.excitation != Velocity::ZERO;
        excited += kept.iter().filter(is_excited).count();
        let links = kept[kept.len() - 1].0.axes.map(|_, axis| axis.link);
        late += links.as_slice().iter().map(|link| link.late).sum::<u32>();
        repeated += links.as_slice().iter().map(|link| link.repeated).sum::<u32>();
    }
    assert!(excited > 500, "{excited} cycles of an excited motion");
    assert!(late > 500 && repeated > 500, "{late} frames late, {repeated} repeated");
    assert!(moved >= 30 && faulted >= 15 && told > 5_000, "{moved} moved, {faulted} faulted, {told} inputs");
}

#[rstest]
fn a_changed_input_is_found_in_its_cycle(#[values("reference", "classic")] name: &str) {
    let (mut kept, _) = eventful(name, 0);
    let at = kept.iter().position(|(record, _)| record.axes[X].mode == ModeTag::Moving).expect("it moves");
    let cycle = kept[at + 7].0.cycle;
    // The record tells of another encoder reading, but not of another position.
    kept[at + 7].0.axes[X].sample.raw.motor_counts ^= 4;
    assert_eq!(first_difference(name, &kept), Some((cycle, "x.sample_position_m".to_owned())));
}

#[rstest]
fn a_missing_order_is_found_where_it_acts(#[values("reference", "classic")] name: &str) {
    let (mut kept, _) = eventful(name, 0);
    let at = kept
        .iter()
        .position(|(_, inputs)| inputs.iter().any(|input| matches!(input.what, What::Order(Order::Enable))))
        .expect("an order to enable");
    let cycle = kept[at].0.cycle;
    kept[at].1.clear();
    let (found, field) = first_difference(name, &kept).expect("the axes are not enabled");
    assert_eq!((found, field.as_str()), (cycle, "x.control_word"));
}

fn replayed(name: &str, kept: &Kept) -> Result<Replay, ReplayError> {
    let cycles =
        kept.iter().map(|(record, inputs)| RecordedCycle { record: *record, inputs: inputs.clone() });
    replay_cycles(&machine(name), cycles.map(Ok), |_| ())
}

/// The replay came so far and ended there, saying this.
#[track_caller]
fn assert_ended(replay: &Replay, cycles: usize, words: &str) {
    assert_eq!(replay.difference, None);
    assert_eq!(replay.cycles, cycles as u64, "cycles that came out as recorded");
    let why = replay.ended_early.as_deref().unwrap_or("nothing");
    assert!(why.contains(words), "says `{why}` and not `{words}`");
}

#[rstest]
fn what_was_lost_on_the_way_to_the_log_ends_the_replay_there(
    #[values("reference", "classic")] name: &str,
    #[values(0, 2)] seed: u64,
) {
    let (kept, _) = eventful(name, seed);
    let whole = replayed(name, &kept).expect("it begins with its run");
    assert_eq!((whole.cycles, whole.ended_early), (kept.len() as u64, None));

    // The inputs of a cycle with an order, or in another log its record too, find no room in the ring.
    let has_order =
        |(_, inputs): &(_, Vec<Input>)| inputs.iter().any(|told| matches!(told.what, What::Order(_)));
    let at = 200 + kept[200..].iter().position(has_order).expect("an order every 100 cycles or so");
    let mut lossy = kept.clone();
    let lost = std::mem::take(&mut lossy[at].1).len();
    let counted = |lossy: &mut Kept, from: usize, count: u64| {
        lossy[from..].iter_mut().for_each(|(record, _)| record.lost_records += count);
    };
    counted(&mut lossy, at + 1, lost as u64);
    let words = format!("{lost} inputs of cycle {} were lost", kept[at].0.cycle);
    assert_ended(&replayed(name, &lossy).expect("it begins with its run"), at, &words);

    let mut lossy = kept.clone();
    lossy.remove(at);
    counted(&mut lossy, at, 1 + lost as u64);
    let words = format!("1 records are missing after cycle {}", kept[at - 1].0.cycle);
    assert_ended(&replayed(name, &lossy).expect("it begins with its run"), at, &words);

    lossy.drain(..100);
    let first = lossy[0].0.cycle;
    let refusal = replayed(name, &lossy).expect_err("its beginning is missing");
    assert!(matches!(refusal, ReplayError::Start(StartError::Headless { first: told }) if told == first));
}

/// Records in a chunk, about.
const CHUNK_RECORDS: usize = 500;

/// A log of a run.
fn written(name: &str, kept: &Kept, folder: &Path) -> PathBuf {
    let path = folder.join("run.mcap");
    let place = Place { pace: Pace::Virtual, interface: None, seed: 0 };
    let origin = Origin { monotonic: Moment::ZERO, wall_ns: 1_800_000_000_000_000_000 };
    let (ring, drain) = record_ring(64);
    let header = header(&machine(name), &place, &origin, "a test");
    let writer = Writer::start(&path, header, drain.ring, drain.inputs, drain.lost).expect("a new log");
    let mut records = Patient(ring);
    for (number, (record, told)) in kept.iter().enumerate() {
        let mut inputs = Inputs::default();
        told.iter().for_each(|input| inputs.push(*input));
        records.put(record, &inputs);
        if number % CHUNK_RECORDS == CHUNK_RECORDS - 1 {
            // A chunk is closed when it is so old.
            std::thread::sleep(Duration::from_millis(130));
        }
    }
    drop(records);
    let outcome = writer.join();
    assert_eq!((outcome.written, outcome.lost), (kept.len() as u64, 0));
    path
}

fn replayed_from(path: &Path) -> Replay {
    let mut log = Reader::open(path).expect("its header is whole");
    replay(&mut log, |_| ()).expect("it begins with its run")
}

#[rstest]
fn a_damaged_chunk_ends_the_replay_there_and_so_does_its_absence(
    #[values("reference", "classic")] name: &str,
) {
    let (kept, _) = eventful(name, 2);
    let folder = tempfile::tempdir().expect("a folder");
    let path = written(name, &kept, folder.path());
    let whole = replayed_from(&path);
    assert_eq!((whole.cycles, whole.difference, whole.ended_early), (kept.len() as u64, None, None));

    let mut bytes = std::fs::read(&path).expect("the log");
    let chunks = mcap::Summary::read(&bytes).expect("an index").expect("an index").chunk_indexes;
    let chunk = &chunks[chunks.len() / 2];
    bytes[(chunk.chunk_start_offset + chunk.chunk_length / 2) as usize] ^= 0x10;
    let damaged = folder.path().join("damaged.mcap");
    std::fs::write(&damaged, bytes).expect("a copy");
    let replay = replayed_from(&damaged);
    let before = replay.cycles as usize;
    assert!((100..kept.len() - 100).contains(&before), "{before} of {} cycles before it", kept.len());
    assert_ended(&replay, before, "damaged.mcap: damaged at byte");

    let recovered = folder.path().join("recovered.mcap");
    let recovery = recover(&damaged, &recovered).expect("most of it is whole");
    assert!(recovery.records_lost > 0 && recovery.records > 1_000, "{recovery:?}");
    let words = format!("records are missing after cycle {}", kept[before - 1].0.cycle);
    assert_ended(&replayed_from(&recovered), before, &words);
}
