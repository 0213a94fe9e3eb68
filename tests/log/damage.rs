//! A damaged log never gives a wrong record: it is refused with the place, cut, or recovered.

use std::collections::BTreeMap;
use std::path::Path;

use quadrant::base::record::CycleRecord;
use quadrant::log::{LogError, Reader, Recovery, recover};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::example::{CHUNK_RECORDS, chunks, folder, header, is_same, read, record, write_in_chunks};

const CHUNKS: u64 = 5;

/// A log of five chunks, its bytes.
fn whole_log() -> Vec<u8> {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    write_in_chunks(&path, CHUNKS);
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(chunks(&bytes).len() as u64, CHUNKS, "chunks");
    bytes
}

fn is_prefix(records: &[CycleRecord]) -> bool {
    records.iter().zip(0..).all(|(read, cycle)| is_same(read, &record(2, cycle)))
}

#[test]
fn a_log_cut_anywhere_reads_up_to_its_last_whole_chunk() {
    let bytes = whole_log();
    let chunks = chunks(&bytes);
    let ends: Vec<_> = chunks.iter().map(|(start, length)| start + length).collect();
    let mut random = Pcg32::seed_from_u64(11);
    let near_ends = ends.iter().flat_map(|end| end - 2..end + 2);
    let anywhere = (0..1500).map(|_| random.random_range(0..bytes.len()));
    for length in (0..200).chain(bytes.len() - 600..bytes.len()).chain(near_ends).chain(anywhere) {
        let (records, end, is_truncated) = read(&bytes[..length]);
        let whole = ends.iter().filter(|end| **end <= length).count() as u64;
        match end {
            Ok(()) => {
                assert!(is_truncated, "cut at {length}");
                assert_eq!(records.len() as u64, whole * CHUNK_RECORDS, "records of a log cut at {length}");
            }
            Err(LogError::NotALog { .. }) if length < 8 => {}
            Err(LogError::HeaderCut { .. }) if length < chunks[0].0 => {}
            Err(error) => panic!("cut at {length}: {error}"),
        }
        assert!(is_prefix(&records), "cut at {length}");
    }
}

#[test]
fn a_flipped_bit_is_always_found() {
    let bytes = whole_log();
    let mut random = Pcg32::seed_from_u64(13);
    let edges = (0..1200).chain(bytes.len() - 1200..bytes.len());
    let anywhere = (0..2000).map(|_| random.random_range(0..bytes.len())).collect::<Vec<_>>();
    for place in edges.chain(anywhere) {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1 << (place % 8);
        let (records, end, is_truncated) = read(&damaged);
        assert!(end.is_err() || is_truncated, "bit {} of byte {place} was not missed", place % 8);
        assert!(is_prefix(&records), "byte {place}");
    }
}

#[test]
fn a_flipped_bit_in_a_cut_log_gives_no_wrong_record() {
    let bytes = whole_log();
    let cut = chunks(&bytes)[3].0 + 100;
    let mut random = Pcg32::seed_from_u64(17);
    for _ in 0..2000 {
        let mut damaged = bytes[..cut].to_vec();
        let place = random.random_range(0..cut);
        damaged[place] ^= 1 << random.random_range(0..8);
        let (records, _, _) = read(&damaged);
        assert!(is_prefix(&records), "byte {place}");
    }
}

#[test]
fn a_chunk_of_a_cut_log_with_another_type_is_not_passed_over() {
    let bytes = whole_log();
    let (start, _) = chunks(&bytes)[1];
    for bit in 0..8 {
        let mut damaged = bytes[..chunks(&bytes)[3].0].to_vec();
        damaged[start] ^= 1 << bit;
        let (records, end, _) = read(&damaged);
        assert!(end.is_err(), "bit {bit} of the type was not missed");
        assert_eq!(records.len() as u64, CHUNK_RECORDS, "records before the damage");
    }
}

#[test]
fn a_damaged_chunk_is_named_by_its_byte() {
    let mut bytes = whole_log();
    let (start, length) = chunks(&bytes)[2];
    bytes[start + length / 2] ^= 4;
    let (records, end, _) = read(&bytes);
    assert_eq!(records.len() as u64, 2 * CHUNK_RECORDS, "records before the damage");
    let message = end.unwrap_err().to_string();
    assert!(message.starts_with(&format!("run.mcap: damaged at byte {start}: ")), "{message}");
}

/// Recovers `bytes` and reads what came of it, which must be a whole log.
fn recovered(bytes: &[u8]) -> (Result<Recovery, LogError>, Vec<CycleRecord>) {
    let folder = folder();
    let (from, to) = (folder.path().join("damaged.mcap"), folder.path().join("recovered.mcap"));
    std::fs::write(&from, bytes).unwrap();
    let recovery = recover(&from, &to);
    let Ok(outcome) = &recovery else { return (recovery, Vec::new()) };
    let (records, end, is_truncated) = read(&std::fs::read(&to).unwrap());
    end.unwrap();
    assert!(!is_truncated);
    assert_eq!(records.len() as u64, outcome.records, "records");
    (recovery, records)
}

#[test]
fn recovery_skips_the_damaged_chunk_and_nothing_else() {
    let mut bytes = whole_log();
    let (start, length) = chunks(&bytes)[2];
    bytes[start + length / 2] ^= 4;
    let (recovery, records) = recovered(&bytes);
    let recovery = recovery.unwrap();
    assert_eq!((recovery.records_lost, recovery.bytes_lost), (CHUNK_RECORDS, length as u64));
    assert!(!recovery.is_header_lost);
    let cycles: Vec<_> = records.iter().map(|record| record.cycle).collect();
    let kept: Vec<_> = (0..2 * CHUNK_RECORDS).chain(3 * CHUNK_RECORDS..CHUNKS * CHUNK_RECORDS).collect();
    assert_eq!(cycles, kept);
    assert!(records.iter().all(|read| is_same(read, &record(2, read.cycle))));
}

#[test]
fn recovery_knows_a_lost_last_chunk_from_the_statistics() {
    let mut bytes = whole_log();
    let (start, length) = chunks(&bytes)[CHUNKS as usize - 1];
    bytes[start + length / 2] ^= 4;
    let recovery = recovered(&bytes).0.unwrap();
    assert_eq!((recovery.records, recovery.records_lost), ((CHUNKS - 1) * CHUNK_RECORDS, CHUNK_RECORDS));
}

#[test]
fn recovery_resynchronises_behind_zeros_and_a_wrong_length() {
    let mut bytes = whole_log();
    let chunks = chunks(&bytes);
    bytes[chunks[1].0 + 3] ^= 0x40; // the length of the record around the chunk: heals
    let zeroed = chunks[3].0 - 300..chunks[3].0 + 60; // tail of an index, head of a chunk
    bytes[zeroed].fill(0);
    assert!(read(&bytes).1.is_err());
    let (recovery, records) = recovered(&bytes);
    assert_eq!(recovery.unwrap().records_lost, CHUNK_RECORDS);
    assert_eq!(records.len() as u64, (CHUNKS - 1) * CHUNK_RECORDS, "records");
}

#[test]
fn recovery_of_a_cut_log_keeps_what_reads_and_its_header() {
    let bytes = whole_log();
    let cut = chunks(&bytes)[3].0 + 100;
    let (recovery, records) = recovered(&bytes[..cut]);
    assert_eq!(recovery.unwrap().bytes_lost, 100, "bytes of the cut chunk");
    assert_eq!(records.len() as u64, 3 * CHUNK_RECORDS, "records");
    assert!(is_prefix(&records));
}

#[test]
fn recovery_keeps_each_part_of_the_header_that_is_whole() {
    let bytes = whole_log();
    let folder = folder();
    let (from, to) = (folder.path().join("damaged.mcap"), folder.path().join("recovered.mcap"));
    let place = |text: &[u8]| bytes.windows(text.len()).position(|found| found == text).unwrap();

    let mut damaged = bytes.clone();
    damaged[place(b"0123abc")] ^= 1; // the commit, in the metadata
    std::fs::write(&from, &damaged).unwrap();
    assert!(recover(&from, &to).unwrap().is_header_lost);
    let kept = Reader::open(&to).unwrap().header().clone();
    assert_eq!((kept.commit.as_str(), kept.machine_text), ("lost", header(2).machine_text));
    assert_eq!((kept.axes, kept.period), (header(2).axes, header(2).period));
    assert_eq!(kept.wall_at_zero_ns, header(2).wall_at_zero_ns);

    std::fs::remove_file(&to).unwrap();
    let mut damaged = bytes.clone();
    damaged[place(b"lead-m")] ^= 1; // the machine file, in the attachment
    std::fs::write(&from, &damaged).unwrap();
    assert!(recover(&from, &to).unwrap().is_header_lost);
    let kept = Reader::open(&to).unwrap().header().clone();
    assert_eq!((kept.commit, kept.machine_text), (header(2).commit, String::new()));
    assert!(kept.extra["recovered"].ends_with("machine file lost"), "{:?}", kept.extra);
}

#[test]
fn recovery_of_random_damage_invents_nothing() {
    let bytes = whole_log();
    let mut random = Pcg32::seed_from_u64(19);
    for _ in 0..60 {
        let mut damaged = bytes.clone();
        for _ in 0..random.random_range(1..6) {
            let from = random.random_range(0..damaged.len());
            let to = (from + random.random_range(1..3000)).min(damaged.len());
            match random.random_range(0..3) {
                0 => damaged[from..to].fill_with(|| random.random()),
                1 => drop(damaged.drain(from..to)),
                _ => drop(damaged.splice(from..from, vec![0xa5; to - from])),
            }
        }
        let (_, records) = recovered(&damaged);
        assert!(records.is_sorted_by_key(|record| record.cycle));
        assert!(records.iter().all(|read| is_same(read, &record(2, read.cycle))));
    }
}

#[test]
fn nothing_is_recovered_from_nothing() {
    let refusal = recovered(&[7; 5000]).0.unwrap_err();
    assert!(matches!(refusal, LogError::NothingToRecover { bytes: 5000, .. }), "{refusal}");
}

#[test]
fn a_log_of_a_newer_version_is_no_damage_and_is_not_recovered() {
    let ours = whole_log();
    let index = mcap::Summary::read(&ours).unwrap().unwrap();
    let mut header = mcap::read::metadata(&ours, &index.metadata_indexes[0]).unwrap();
    header.metadata.insert("format_version".to_owned(), "9999".to_owned());
    let mut hasher = crc32fast::Hasher::new();
    for (key, value) in header.metadata.iter().filter(|(key, _)| *key != "crc32") {
        hasher.update(format!("{key}\0{value}\0").as_bytes());
    }
    header.metadata.insert("crc32".to_owned(), format!("{:08x}", hasher.finalize()));
    let mut file = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    file.write_metadata(&header).unwrap();
    file.finish().unwrap();
    let mut newer = file.into_inner().into_inner();
    let refusal = recovered(&newer).0.unwrap_err();
    assert!(matches!(refusal, LogError::Version { found: 9999, .. }), "{refusal}");

    // Nor are chunks that happen to read like ours.
    let (start, length) = chunks(&ours)[0];
    newer.extend_from_slice(&ours[start..start + length]);
    let refusal = recovered(&newer).0.unwrap_err();
    assert!(matches!(refusal, LogError::Version { found: 9999, .. }), "{refusal}");
}

/// An MCAP file with the header of a log and whatever else `fill` puts in.
fn foreign(has_header: bool, fill: impl FnOnce(&mut mcap::Writer<std::io::Cursor<Vec<u8>>>)) -> LogError {
    let ours = whole_log();
    let index = mcap::Summary::read(&ours).unwrap().unwrap();
    let mut file = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    if has_header {
        file.write_metadata(&mcap::read::metadata(&ours, &index.metadata_indexes[0]).unwrap()).unwrap();
        file.attach(&mcap::read::attachment(&ours, &index.attachment_indexes[0]).unwrap()).unwrap();
    }
    fill(&mut file);
    file.finish().unwrap();
    read(&file.into_inner().into_inner()).1.unwrap_err()
}

#[test]
fn what_is_not_ours_is_refused_by_name() {
    let named = |topic: &'static str, schema: &'static str| {
        move |file: &mut mcap::Writer<_>| {
            let id = file.add_schema(schema, "ros2msg", b"float64 speed").unwrap();
            file.add_channel(id, topic, "cdr", &BTreeMap::new()).unwrap();
        }
    };
    let error = foreign(false, named("/cycle", "quadrant/msg/Cycle")).to_string();
    assert!(error.contains("not a log of this project: it has no `quadrant` metadata"), "{error}");
    let error = foreign(true, named("/odom", "nav_msgs/msg/Odometry")).to_string();
    assert!(
        error.contains("schema `nav_msgs/msg/Odometry` (ros2msg), expected `quadrant/msg/Cycle`"),
        "{error}"
    );
    let error = foreign(true, |_| ()).to_string();
    assert!(error.ends_with("no channel `/cycle`"), "{error}");
    let error = read(b"PK\x03\x04 something else entirely").1.unwrap_err().to_string();
    assert!(error.contains("does not start as MCAP"), "{error}");
    assert!(Reader::open(Path::new("nowhere.mcap")).is_err());
}
