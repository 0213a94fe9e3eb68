//! What is made of a log: a table, a summary, and the same numbers in Python.

use std::fmt::Write as _;
use std::fs::File;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use quadrant::base::axis::PerAxis;
use quadrant::base::frame::{Frame, Id, Received};
use quadrant::base::input::{Input, What};
use quadrant::base::order::{LineMotion, Order};
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::log::{Reader, Summary, Writer, csv};

use crate::example::{folder, header, record, write};

#[test]
fn a_table_holds_every_number_under_a_name_with_its_unit() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    write(&path, 2, 1500);
    let mut table = Vec::new();
    let lines = csv::export(&mut Reader::open(&path).unwrap(), &mut table, Path::new("run.csv")).unwrap();
    assert_eq!(lines, 1500);

    let mut table = ::csv::Reader::from_reader(&table[..]);
    let names = table.headers().unwrap().clone();
    let column = |name: &str| names.iter().position(|column| column == name).unwrap();
    let (cycle, error, measured) = (column("cycle"), column("y.following_error_m"), column("is_measured"));
    let scale = column("x.sample_table_position_m");
    for (number, line) in table.records().enumerate() {
        let line = line.unwrap();
        let expected = record(2, number as u64);
        let error_m: f64 = line[error].parse().unwrap();
        let expected_m = expected.axes.as_slice()[1].command.terms.following_error.as_m();
        assert_eq!(error_m.to_bits(), expected_m.to_bits(), "{error_m} m is not {expected_m} m");
        assert_eq!((&line[cycle], &line[scale]), (number.to_string().as_str(), "NaN"));
        assert_eq!(&line[measured], if number > 100 { "1" } else { "0" });
    }
}

#[test]
fn a_summary_of_a_log_counts_its_faults() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    write(&path, 2, 3000);
    let reader = Reader::open(&path).unwrap();
    let summary = Summary::of(&header(2), reader).unwrap();
    assert_eq!((summary.cycles, summary.cycles_missing, summary.overruns), (3000, 0, 2999 / 700));
    assert!((summary.duration_s - 1.5).abs() < 1e-9, "{} s", summary.duration_s);
    assert!((summary.wake_error_us_max - 3.0).abs() < 3e-3, "{} us", summary.wake_error_us_max);
    let cycles: Vec<_> = summary.faults.iter().map(|fault| (fault.axis.as_str(), fault.cycle)).collect();
    assert_eq!(cycles, [("x", 999), ("y", 999), ("x", 1999), ("y", 1999), ("x", 2999), ("y", 2999)]);
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["axes"][1]["cycles_by_mode"]["moving"], 3000);
}

#[test]
fn python_reads_the_same_numbers() {
    let modules = Command::new("python3").args(["-c", "import mcap, mcap_ros2"]).output();
    if !modules.is_ok_and(|modules| modules.status.success()) {
        eprintln!("SKIPPED: python3 with the packages mcap and mcap-ros2-support is not installed");
        return;
    }
    let folder = folder();
    let (log, table) = (folder.path().join("run.mcap"), folder.path().join("run.csv"));
    let told = folder.path().join("told.csv");
    std::fs::write(&told, write_with_inputs(&log, 1500)).unwrap();
    csv::export(&mut Reader::open(&log).unwrap(), File::create(&table).unwrap(), &table).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/read_log.py");
    let outcome = Command::new("python3").arg(script).args([&log, &table, &told]).output().unwrap();
    let said = String::from_utf8_lossy(&outcome.stdout).into_owned();
    assert!(outcome.status.success(), "{said}{}", String::from_utf8_lossy(&outcome.stderr));
    assert!(said.contains("1500 cycles") && said.contains("30 inputs"), "{said}");
}

/// A log of that many cycles, every fiftieth told a frame or an order; what they were told, as a table.
fn write_with_inputs(path: &Path, cycles: u64) -> String {
    let (mut records, written) = rtrb::RingBuffer::new(cycles as usize);
    let (mut inputs, told) = rtrb::RingBuffer::new(cycles as usize);
    let mut table = "cycle,kind,at_ns,identifier,payload,target_x_m,feed_m_per_s\n".to_owned();
    for cycle in 0..cycles {
        let at = Moment::ZERO + Span::us(500) * cycle as i64;
        let what = match cycle % 100 {
            0 => {
                let payload = [cycle as u8, 0x80, 0xFF, 1, 2, 3, 4, 5, 6, 7, 8, 9];
                let frame = Frame::fd(Id::new(0x701).unwrap(), payload);
                writeln!(table, "{cycle},0,{},{},{},0,0", at.as_ns(), 0x701, hex(&payload)).unwrap();
                Some(What::Frame { place: 2, received: Received { frame, at } })
            }
            50 => {
                let line = LineMotion {
                    target: PerAxis::from_fn(2, |_| Position::m(cycle as f64 * 1e-3)),
                    feed: Velocity::m_per_s(0.1),
                    acceleration: Acceleration::m_per_s2(2.0),
                };
                writeln!(table, "{cycle},6,0,0,,{:?},0.1", cycle as f64 * 1e-3).unwrap();
                Some(What::Order(Order::Line(line)))
            }
            _ => None,
        };
        what.into_iter().for_each(|what| inputs.push(Input { cycle, what }).unwrap());
        records.push(record(2, cycle)).unwrap();
    }
    drop((records, inputs));
    assert!(Writer::start(path, header(2), written, told, Arc::default()).unwrap().join().is_complete);
    table
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}"))
}
