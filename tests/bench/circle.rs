//! What `quadrant circle` costs: the whole command as a process, and its parts one after another on one
//! core. The command runs log, twin and trace beside the machine on as many cores as there are.
//!
//! The test is the default one: both directions, one turn each of 150 mm at 2000 mm/min.

mod fastest;

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use fastest::fastest_s;
use quadrant::base::input::Inputs;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::record::CycleRecord;
use quadrant::base::units::{Position, Velocity};
use quadrant::config::plan::CircleRequest;
use quadrant::config::{self, Machine};
use quadrant::log::{Header, Pace, Writer};
use quadrant::offline::circle::{self, CircularTest, Run};
use quadrant::offline::report::{self, TestSheet};
use quadrant::offline::trace::Trace;
use quadrant::rt::cycle::pace::Virtual;
use quadrant::rt::cycle::procedure::Procedure;
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::{Records, record_ring};
use quadrant::sim::closed_loop::{Patient, Wired};

const SEED: u64 = 7;
const RING_RECORDS: usize = 8_192;
/// Number of each circle among the motions: a straight move leads to it.
const MOTIONS: [u32; 2] = [2, 4];

fn main() {
    let machine = config::load("reference").expect("the embedded machine is right");
    let request = request();
    let records = self::records(&machine, &request);
    let span_s = records.len() as f64 * machine.cycle.period.as_s();
    println!("circular test in both directions: {} cycles, {span_s:.1} s on the machine", records.len());

    say("whole command, simulated in virtual time", span_s, fastest_s(command));
    say("  cycles with boards and plants", span_s, fastest_s(|| run(&machine, &request, &mut Discarded)));
    say("  log", span_s, fastest_s(|| log(&machine, &records)));
    let frictionless = machine.clone().without_friction();
    let twin_records = self::records(&frictionless, &request);
    say("  twin without friction", span_s, fastest_s(|| run(&frictionless, &request, &mut Discarded)));
    say("  trace of records", span_s, fastest_s(|| drop(trace(&records))));
    let (paths, twins) = (trace(&records), trace(&twin_records));
    say("  analysis", span_s, fastest_s(|| drop(analyse(&request, &paths, &twins))));
    let test = analyse(&request, &paths, &twins);
    let folder = tempfile::tempdir().expect("temporary storage");
    let write = || draw(folder.path(), &request, &test, &paths, &twins);
    say("  report: page, drawing, picture", span_s, fastest_s(write));
}

fn say(what: &str, span_s: f64, took_s: f64) {
    println!("{what:<42} {:>7.0} ms  {:>6.0} times real time", took_s * 1e3, span_s / took_s);
}

fn request() -> CircleRequest {
    let circle = Circle {
        centre_x: Position::ZERO,
        centre_y: Position::ZERO,
        radius: Position::mm(150.0),
        feed: Velocity::mm_per_min(2000.0),
        direction: Direction::Ccw,
        start_angle_rad: std::f64::consts::FRAC_PI_4,
        revolutions: 1,
    };
    CircleRequest { gains: "standard".to_owned(), circle, directions: vec![Direction::Ccw, Direction::Cw] }
}

fn command() {
    let folder = tempfile::tempdir().expect("temporary storage");
    let status = Command::new(env!("CARGO_BIN_EXE_quadrant"))
        .args(["circle", "--json", "--out"])
        .arg(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    assert!(status.expect("the tool was built").success(), "the test was not completed");
}

struct Kept(Vec<CycleRecord>);

impl Records for Kept {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        self.0.push(*record);
    }
    fn lost(&self) -> u64 {
        0
    }
}

/// Nobody looks at the records.
struct Discarded;

impl Records for Discarded {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        black_box(record);
    }
    fn lost(&self) -> u64 {
        0
    }
}

fn run(machine: &Machine, request: &CircleRequest, records: &mut impl Records) {
    let mut bus = Wired::new(machine.rack(SEED));
    let drives = bus.commission(machine.drives().expect("each axis has its own node"));
    let drives = drives.expect("a simulated board says what its sheet says");
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let test = machine.circle_test(request).expect("the circle fits the machine");
    let mut orders = Procedure::new(test, Arc::default());
    conduct(&mut cycle, &mut bus, &mut Virtual::new(machine.cycle.period), &mut orders, records);
}

fn records(machine: &Machine, request: &CircleRequest) -> Vec<CycleRecord> {
    let mut kept = Kept(Vec::new());
    run(machine, request, &mut kept);
    kept.0
}

fn log(machine: &Machine, records: &[CycleRecord]) {
    let folder = tempfile::tempdir().expect("temporary storage");
    let header = Header {
        project_version: String::new(),
        commit: String::new(),
        machine_name: machine.name.clone(),
        machine_text: machine.text.clone(),
        sheets: Default::default(),
        seed: SEED,
        pace: Pace::Virtual,
        wall_at_zero_ns: 0,
        axes: machine.axis_names(),
        period: machine.cycle.period,
        gain_sets: machine.gain_sets.clone(),
        motions: BTreeMap::new(),
        extra: BTreeMap::new(),
    };
    let (ring, drain) = record_ring(RING_RECORDS);
    let path = folder.path().join("circle.mcap");
    let writer = Writer::start(&path, header, drain.ring, drain.inputs, drain.lost)
        .expect("a new file in a new folder");
    let mut ring = Patient(ring);
    let inputs = Inputs::default();
    records.iter().for_each(|record| ring.put(record, &inputs));
    drop(ring);
    assert_eq!(writer.join().written, records.len() as u64, "records in the log");
}

fn trace(records: &[CycleRecord]) -> [Trace; 2] {
    let whole = Trace::from_records(records).expect("records in order");
    MOTIONS.map(|motion| whole.stretch(motion).expect("both circles were run"))
}

fn runs<'a>(request: &CircleRequest, paths: &'a [Trace; 2], twins: &'a [Trace; 2]) -> Vec<Run<'a>> {
    let each = request.directions.iter().zip(paths.iter().zip(twins));
    each.map(|(direction, (trace, twin))| Run {
        nominal: Circle { direction: *direction, ..request.circle },
        trace,
        friction_free: Some(twin),
    })
    .collect()
}

fn analyse(request: &CircleRequest, paths: &[Trace; 2], twins: &[Trace; 2]) -> CircularTest {
    circle::analyse(&runs(request, paths, twins)).expect("both circles are complete")
}

fn draw(folder: &Path, request: &CircleRequest, test: &CircularTest, paths: &[Trace; 2], twins: &[Trace; 2]) {
    let sheet = TestSheet {
        machine: "reference".to_owned(),
        gains: request.gains.clone(),
        date: String::new(),
        log: String::new(),
        commit: String::new(),
        pace: String::new(),
        cycles: 0,
        overruns: 0,
        lost_records: 0,
        notes: Vec::new(),
        expectations: Vec::new(),
    };
    report::write(folder, &sheet, test, &runs(request, paths, twins)).expect("a new folder");
}
