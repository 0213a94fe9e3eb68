//! A disk that refuses never stops a run, and nothing that exists is overwritten.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use quadrant::log::{LogError, Reader, Writer};

use crate::example::{folder, header, is_same, record, write, write_with};

#[test]
fn a_full_disk_is_drained_and_counted_to_the_last_record() {
    let records = (0..20_000).map(|cycle| record(2, cycle));
    let (outcome, lost) = write_with(Path::new("/dev/full"), 2, 1024, records);
    assert_eq!((outcome.written, outcome.lost, outcome.is_complete), (0, 20_000, false));
    assert_eq!(lost, 20_000, "records counted for the cycle");
    let error = outcome.first_error.unwrap();
    assert!(error.starts_with("/dev/full: ") && error.contains("No space left"), "{error}");
}

/// Says to the process started by the test below where to write.
const LOG: &str = "QUADRANT_TEST_SMALL_DISK";

/// The test starts itself again under a limit on the size of a file, which refuses in the middle of
/// a write like a disk that fills up.
#[test]
fn a_disk_that_fills_up_keeps_every_record_it_took() {
    if let Ok(path) = std::env::var(LOG) {
        let (outcome, lost) = write_with(path.as_ref(), 2, 4096, (0..20_000).map(|cycle| record(2, cycle)));
        assert_eq!(lost, outcome.lost, "records");
        assert!(outcome.first_error.unwrap().contains("File too large"));
        println!("written {} lost {} end", outcome.written, outcome.lost);
        return;
    }
    let folder = folder();
    let path = folder.path().join("run.mcap");
    let child = Command::new("bash")
        .args(["-c", "trap '' XFSZ; ulimit -f 1500; exec \"$0\" --exact \"$1\" --nocapture"])
        .arg(std::env::current_exe().unwrap())
        .arg("disk::a_disk_that_fills_up_keeps_every_record_it_took")
        .env(LOG, &path)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&child.stdout).into_owned();
    assert!(child.status.success(), "{text}{}", String::from_utf8_lossy(&child.stderr));
    let number = |after: &str| -> u64 {
        let start = text.find(after).unwrap() + after.len();
        text[start..].split_whitespace().next().unwrap().parse().unwrap()
    };
    let (written, lost) = (number("written "), number(" lost "));
    assert!(written > 1000 && lost > 1000 && written + lost == 20_000, "written {written} lost {lost}");

    let mut reader = Reader::open(&path).unwrap();
    for cycle in 0..written {
        let read = reader.next().unwrap().unwrap();
        assert!(is_same(&read, &record(2, cycle)), "cycle {cycle}");
    }
    assert!(reader.next().is_none());
    assert!(reader.is_truncated());
}

#[test]
fn a_log_is_never_overwritten() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    write(&path, 2, 10);
    let before = std::fs::read(&path).unwrap();
    let (_ring, consumer) = rtrb::RingBuffer::new(4);
    let refusal =
        Writer::start(&path, header(2), consumer, rtrb::RingBuffer::new(1).1, Arc::default()).unwrap_err();
    assert!(matches!(refusal, LogError::Exists { .. }), "{refusal}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[test]
fn a_folder_that_is_not_there_is_refused_before_the_run() {
    let folder = folder();
    let path = folder.path().join("nowhere/run.mcap");
    let (_ring, consumer) = rtrb::RingBuffer::new(4);
    let refusal = Writer::start(&path, header(2), consumer, rtrb::RingBuffer::new(1).1, Arc::default())
        .unwrap_err()
        .to_string();
    assert!(refusal.contains("nowhere/run.mcap: cannot create: No such file"), "{refusal}");
}

#[test]
fn the_header_is_in_the_file_before_the_first_record() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    let (_ring, consumer) = rtrb::RingBuffer::new(4);
    let _writer =
        Writer::start(&path, header(2), consumer, rtrb::RingBuffer::new(1).1, Arc::default()).unwrap();
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!(reader.header(), &header(2));
    assert!(reader.next().is_none());
    assert!(reader.is_truncated());
}
