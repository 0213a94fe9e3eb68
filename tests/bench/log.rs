//! How fast a log is written and read: records of two axes, to and from a file in memory-backed or
//! ordinary temporary storage. A virtual run makes them as fast as it can, so this bounds it.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use divan::Bencher;
use divan::counter::ItemsCount;
use quadrant::base::axis::AxisId;
use quadrant::base::record::CycleRecord;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Current, Position};
use quadrant::log::{Header, Pace, Reader, Writer};

const RECORDS: u64 = 200_000;

fn main() {
    divan::main();
}

fn header() -> Header {
    Header {
        project_version: String::new(),
        commit: String::new(),
        machine_name: "reference".to_owned(),
        machine_text: String::new(),
        sheets: Default::default(),
        seed: 7,
        pace: Pace::Virtual,
        wall_at_zero_ns: 1_800_000_000_000_000_000,
        axes: vec!["x".to_owned(), "y".to_owned()],
        period: Span::us(500),
        gain_sets: Vec::new(),
        motions: BTreeMap::new(),
        extra: BTreeMap::new(),
    }
}

/// A circle at 0.2 rad/s with encoder counts of 16 nm, so that it compresses like a real one.
fn record(cycle: u64) -> CycleRecord {
    let phase_rad = cycle as f64 * 1e-4;
    let mut record = CycleRecord::empty(2);
    record.cycle = cycle;
    record.timing.scheduled = Moment::ZERO + Span::us(500) * cycle as i64;
    for (axis, place_m) in [(AxisId::X, 0.15 * phase_rad.cos()), (AxisId::Y, 0.15 * phase_rad.sin())] {
        let counts = (place_m / 16e-9).round();
        let axis = &mut record.axes[axis];
        axis.setpoint.position = Position::m(place_m);
        axis.sample.position = Position::m(counts * 16e-9);
        axis.sample.raw.motor_counts = counts as i64 as u32;
        axis.command.terms.following_error = axis.setpoint.position - axis.sample.position;
        axis.command.current = Current::a(place_m * 3.0);
    }
    record
}

fn write(path: &Path, records: &[CycleRecord]) {
    let (mut ring, consumer) = rtrb::RingBuffer::new(1 << 16);
    let writer = Writer::start(path, header(), consumer, rtrb::RingBuffer::new(1).1, Arc::default())
        .expect("a new file in a new folder");
    for record in records {
        while ring.push(*record).is_err() {
            std::thread::yield_now();
        }
    }
    drop(ring);
    assert_eq!(writer.join().lost, 0, "records lost");
}

/// Ring to finished file.
#[divan::bench(sample_count = 5, sample_size = 1)]
fn write_records(bencher: Bencher<'_, '_>) {
    let records: Vec<_> = (0..RECORDS).map(record).collect();
    bencher
        .with_inputs(|| tempfile::tempdir().expect("temporary storage"))
        .counter(ItemsCount::new(RECORDS))
        .bench_local_refs(|folder| write(&folder.path().join("run.mcap"), &records));
}

/// File to records, checksums verified.
#[divan::bench(sample_count = 5, sample_size = 1)]
fn read_records(bencher: Bencher<'_, '_>) {
    let folder = tempfile::tempdir().expect("temporary storage");
    let path = folder.path().join("run.mcap");
    write(&path, &(0..RECORDS).map(record).collect::<Vec<_>>());
    let bytes = std::fs::metadata(&path).expect("just written").len();
    println!("{} bytes a record in the file", bytes / RECORDS);
    bencher.counter(ItemsCount::new(RECORDS)).bench_local(|| {
        let reader = Reader::open(&path).expect("just written");
        assert_eq!(
            reader.map(|record| black_box(record).is_ok()).filter(|is_ok| *is_ok).count() as u64,
            RECORDS
        );
    });
}
