//! How long one cycle of two axes takes while it drives a circle: from frames in to frames out and the
//! record in the ring, on the host alone; then with the boards, the plants and the emptying of the ring.
//!
//! Every cycle is timed by itself. The boards of a rack answer outside of the timed part, so the caches
//! are as used as a working machine leaves them. What two reads of the clock cost is measured and
//! subtracted.
//!
//! `cargo bench --bench cycle -- --paced` runs the same at 1 kHz on the wall clock, its thread prepared for
//! real time: the caches are then what a sleeping machine leaves. `tests/bench/beside_linuxcnc` uses it.

use std::time::Instant;

#[path = "../common/circle_run.rs"]
#[expect(dead_code, reason = "the cycles are run here, one by one")]
mod circle_run;

use circle_run::{SEED, paper_circle, procedure, wired};
use quadrant::base::time::{Moment, Span};
use quadrant::config::{self, Machine};
use quadrant::rt::bus::memory::{self, End};
use quadrant::rt::bus::{Bus, Frame};
use quadrant::rt::cycle::Cycle;
use quadrant::rt::cycle::pace::{Pace, Virtual, Wall, monotonic_now};
use quadrant::rt::cycle::procedure::Procedure;
use quadrant::rt::door::{Orders, RecordDrain, RecordRing, Records, record_ring};
use quadrant::rt::thread::{Process, Thread};
use quadrant::rt::wire::command;
use quadrant::sim::rack::Rack;

/// Turns of the circle: 4 at 2000 mm/min and 150 mm are 226,195 cycles of 0.5 ms.
const REVOLUTIONS: u32 = 4;
/// Frames that fit on each bus, records that fit into the ring.
const CAPACITY: usize = 64;
const AXES: usize = 2;

/// Turns of the circle in a paced run: 28 s each.
const REVOLUTIONS_PACED: u32 = 1;

fn main() {
    let clock_ns = clock_cost_ns();
    if std::env::args().any(|argument| argument == "--paced") {
        return paced(clock_ns);
    }
    let machine = config::load("reference").expect("the embedded machine is right");
    println!(
        "two axes on the reference circle, {REVOLUTIONS} turns; two clock reads cost {clock_ns} ns, subtracted"
    );
    let pace = Virtual::new(machine.cycle.period);
    let mut bench = Bench::new(&machine, pace, REVOLUTIONS);
    bench.run();
    report("host cycle: frames in to frames out, record in the ring", &mut bench.host_ns, clock_ns);
    report("whole cycle in memory: boards, plants and ring too", &mut bench.whole_ns, clock_ns);
}

/// At 1 kHz on the wall clock.
fn paced(clock_ns: u64) {
    let machine = config::load("classic").expect("the embedded machine is right");
    let _process = Process::prepare();
    let thread = Thread::prepare(&machine.real_time);
    let pace = Wall::starting_at(monotonic_now() + Span::ms(20), machine.cycle.period);
    let mut bench = Bench::new(&machine, pace, REVOLUTIONS_PACED);
    bench.run();
    println!("paced at {} us, {:?}", machine.cycle.period.as_us(), thread.scheduling);
    report("host cycle: frames in to frames out, record in the ring", &mut bench.host_ns, clock_ns);
}

/// The host at one end, the rack at the other, and between them this bench, which carries the frames.
struct Bench<P> {
    host: End,
    host_far: End,
    machine: End,
    machine_far: End,
    rack: Rack,
    cycle: Cycle,
    orders: Procedure,
    pace: P,
    ring: RecordRing,
    drain: RecordDrain,
    host_ns: Vec<u64>,
    whole_ns: Vec<u64>,
}

impl<P: Pace> Bench<P> {
    fn new(machine: &Machine, pace: P, revolutions: u32) -> Self {
        let (bus, cycle) = wired(machine, SEED);
        let (host, host_far) = memory::pair(CAPACITY);
        let (machine_near, machine_far) = memory::pair(CAPACITY);
        let (ring, drain) = record_ring(CAPACITY);
        Self {
            host,
            host_far,
            machine: machine_near,
            machine_far,
            rack: bus.into_rack(),
            cycle,
            orders: procedure(machine, "optimal", paper_circle(revolutions)),
            pace,
            ring,
            drain,
            host_ns: Vec::new(),
            whole_ns: Vec::new(),
        }
    }

    fn run(&mut self) {
        loop {
            let start = Instant::now();
            let slot = self.pace.wait();
            self.answer(slot.number as u32);
            let host_start = Instant::now();
            let pace = &self.pace;
            let (record, inputs) =
                self.cycle.run(&mut self.host, &mut self.orders, &slot, &mut || pace.now());
            record.lost_records = self.ring.lost();
            self.ring.put(record, inputs);
            let host_end = Instant::now();
            self.pace.finish();
            self.carry_commands();
            let written = self.drain.ring.pop();
            while self.drain.inputs.pop().is_ok() {}
            let end = Instant::now();
            let written = written.expect("a record of each cycle");
            if written.stage.is_measured {
                self.host_ns.push((host_end - host_start).as_nanos() as u64);
                self.whole_ns.push((end - start).as_nanos() as u64);
            }
            if self.orders.is_done(&written) {
                return;
            }
        }
    }

    /// The boards answer the SYNC that the host is about to send.
    fn answer(&mut self, cycle: u32) {
        send(&mut self.machine_far, &command::encode_sync(cycle));
        self.rack.serve(&mut self.machine);
        while let Some(answer) = self.machine_far.receive(Moment::ZERO) {
            send(&mut self.host_far, &answer.frame);
        }
    }

    /// The host's commands reach the boards; its SYNC was theirs already.
    fn carry_commands(&mut self) {
        let sync = self.host_far.receive(Moment::ZERO).expect("SYNC comes first");
        assert!(command::decode_sync(&sync.frame).is_ok(), "SYNC comes first");
        while let Some(command) = self.host_far.receive(Moment::ZERO) {
            send(&mut self.machine_far, &command.frame);
        }
    }
}

fn send(bus: &mut End, frame: &Frame) {
    bus.send(frame).expect("the bus has room for a cycle");
}

/// What stands between two clock reads with nothing between them, median.
fn clock_cost_ns() -> u64 {
    let mut costs: Vec<_> = (0..100_000)
        .map(|_| {
            let start = Instant::now();
            start.elapsed().as_nanos() as u64
        })
        .collect();
    percentile(&mut costs, 0.5)
}

fn report(what: &str, ns: &mut [u64], clock_ns: u64) {
    let [p50, p99, p999, max] =
        [0.5, 0.99, 0.999, 1.0].map(|part| percentile(ns, part).saturating_sub(clock_ns));
    println!("{what}, {} cycles", ns.len());
    println!(
        "  p50 {p50} ns ({} ns per axis)  p99 {p99} ns  p99.9 {p999} ns  max {max} ns",
        p50 / AXES as u64
    );
}

fn percentile(values: &mut [u64], part: f64) -> u64 {
    values.sort_unstable();
    let last = values.len() - 1;
    values[(part * last as f64).round() as usize]
}
