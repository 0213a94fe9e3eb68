//! Killed at any moment, a log lacks at most the last 250 ms and reads without repair.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use quadrant::base::time::{Moment, Span};
use quadrant::log::{Reader, Writer};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::example::{folder, header, record};

/// Says to the process that will be killed where to write.
const FOLDER: &str = "QUADRANT_TEST_KILL";
const PERIOD: Duration = Duration::from_micros(500);
const LOSS_MAX: Span = Span::ms(250);

#[test]
fn a_killed_run_lacks_at_most_the_last_250_ms() {
    if let Ok(folder) = std::env::var(FOLDER) {
        record_until_killed(folder.as_ref());
    }
    let mut random = Pcg32::seed_from_u64(7);
    for kill in 0..6 {
        let wait = Duration::from_micros(random.random_range(150_000..900_000));
        let folder = folder();
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "kill::a_killed_run_lacks_at_most_the_last_250_ms"])
            .env(FOLDER, folder.path())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let progress = folder.path().join("progress");
        while last_recorded(&progress).is_none() {
            sleep(Duration::from_millis(1));
        }
        sleep(wait);
        child.kill().unwrap();
        child.wait().unwrap();

        let last = last_recorded(&progress).unwrap();
        let mut reader = Reader::open(&folder.path().join("run.mcap")).unwrap();
        let mut read = Moment::ZERO;
        let mut cycles = 0;
        for record in &mut reader {
            let record = record.unwrap();
            assert_eq!(record.cycle, cycles, "cycle");
            cycles += 1;
            read = record.timing.woke;
        }
        assert!(reader.is_truncated(), "kill {kill}: the process was to have no time to finish");
        let loss = last - read;
        println!(
            "kill {kill} after {wait:?}: {cycles} cycles read, the last {} ms lost",
            loss.as_us() * 1e-3
        );
        assert!(loss <= LOSS_MAX, "kill {kill} after {wait:?}: the last {} us are lost", loss.as_us());
    }
}

/// When the last record was handed over, by the killed process's own account.
fn last_recorded(progress: &Path) -> Option<Moment> {
    let mut word = [0; 8];
    File::open(progress).ok()?.read_exact_at(&mut word, 0).ok()?;
    Some(Moment::ns(i64::from_le_bytes(word)))
}

/// A 2 kHz loop as a run has it; what it handed over stands in a file that survives it.
fn record_until_killed(folder: &Path) -> ! {
    let progress = File::create(folder.join("progress")).unwrap();
    let (mut ring, consumer) = rtrb::RingBuffer::new(8192);
    let _writer = Writer::start(
        &folder.join("run.mcap"),
        header(2),
        consumer,
        rtrb::RingBuffer::new(1).1,
        Arc::default(),
    )
    .unwrap();
    let start = Instant::now();
    for cycle in 0_u32.. {
        sleep((start + PERIOD * cycle).saturating_duration_since(Instant::now()));
        let mut record = record(2, u64::from(cycle));
        record.timing.woke = Moment::ns(start.elapsed().as_nanos() as i64);
        ring.push(record).unwrap();
        progress.write_all_at(&record.timing.woke.as_ns().to_le_bytes(), 0).unwrap();
    }
    unreachable!("the counter is never used up")
}
