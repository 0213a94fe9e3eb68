//! Machines: that of the known answers, and others drawn from a seed, as unlike each other as real ones are.
//! Invariant: the same seed gives the same machine.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::path::{Motion, Run};
use crate::plant::{Control, IDEAL, Plant, Sensors};

/// Of every drive, A.
pub const CURRENT_MAX: f64 = 20.0;

/// In m/s.
const MM_PER_MIN: f64 = 1e-3 / 60.0;

/// Source of everything random here.
pub type Random = Pcg64Mcg;

/// A source for a seed and a purpose, so that purposes do not shift each other.
pub fn random(seed: u64, purpose: u64) -> Random {
    Random::seed_from_u64(
        seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ purpose.wrapping_mul(0xd1b5_4a32_d192_ed03),
    )
}

/// From `low` to `high`, as likely in each octave.
pub fn log_uniform(random: &mut Random, low: f64, high: f64) -> f64 {
    random.random_range(low.ln()..high.ln()).exp()
}

/// One axis, as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisDesign {
    /// Mechanics and drive.
    pub plant: Plant,
    /// Its controller.
    pub control: Control,
    /// Its sensors.
    pub sensors: Sensors,
}

/// A machine of two axes, as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Its name.
    pub name: String,
    /// The seed that it was drawn from.
    pub seed: u64,
    /// x and y.
    pub axes: [AxisDesign; 2],
    /// What is run on it.
    pub runs: Vec<Run>,
}

impl Machine {
    /// The machine of the known answers: no dead time, no error of any sensor, standard gains.
    pub fn paper() -> Self {
        let plant = Plant {
            mass: 335.0,
            stiffness: 151e6,
            damping: 73.8e3,
            inertia: 0.0064,
            screw_share: 0.0,
            lead: 0.01,
            efficiency: 0.9,
            torque_constant: 1.0,
            current_loop_hz: 300.0,
            breakaway: 1127.8,
            sliding: 951.3,
            fall_start: 0.1e-3,
            fall_end: 0.5e-3,
            viscous: 0.0,
        };
        let control = Control {
            position_gain: 8.55,
            velocity_feed_forward: 0.0,
            proportional: 0.0150 * 101.121,
            integral: 0.0150 * 101.121 * 1.140 * 103.35,
            current_max: CURRENT_MAX,
            delay: 0.0,
            is_second_order: true,
        };
        let axis = AxisDesign { plant, control, sensors: IDEAL };
        Self { name: "paper".to_owned(), seed: 0, axes: [axis; 2], runs: runs(&mut random(0, 2)) }
    }

    /// The same with runs that take less than half as long: circles of half the radius, the slow one of those to be fitted one way and the fast
    /// one the other, and every second speed and reversal.
    #[must_use]
    pub fn brief(mut self) -> Self {
        let is_fitted = |run: &Run| matches!(run.motion, Motion::Circle { .. }) && !run.is_held_out;
        let mut fitted: Vec<String> =
            self.runs.iter().filter(|run| is_fitted(run)).map(|run| run.name.clone()).collect();
        fitted.drain(1..fitted.len() - 1);
        self.runs.retain(|run| !is_fitted(run) || fitted.contains(&run.name));
        for run in &mut self.runs {
            match &mut run.motion {
                Motion::Circle { radius, feed, is_ccw, .. } => {
                    *run = circle(0.5 * *radius, *feed, *is_ccw, run.is_held_out);
                }
                Motion::Sweep { speeds: all, .. } | Motion::MicroReversals { amplitudes: all, .. } => {
                    *all = all.iter().copied().skip(1).step_by(2).collect();
                }
                Motion::Acceleration { .. } => {}
            }
        }
        self
    }

    /// A machine of this seed: every sixth is that of the known answers behind real sensors, the others are unlike it.
    pub fn drawn(seed: u64) -> Self {
        let mut source = random(seed, 1);
        let mut machine = Self::paper();
        machine.seed = seed;
        machine.runs = runs(&mut random(seed, 2));
        if seed.is_multiple_of(6) {
            for axis in &mut machine.axes {
                axis.sensors = sensors(&mut source, &axis.plant);
            }
            return machine;
        }
        machine.name = format!("hidden {seed}");
        let (x, slower) = drawn_axis(&mut source);
        // The second axis carries the first or is carried by it: the same kind with another table.
        let mut y = x;
        y.plant.mass *= source.random_range(0.6..1.6);
        y.plant.stiffness *= source.random_range(0.8..1.25);
        let level = source.random_range(0.8..1.3);
        y.plant.sliding *= level;
        y.plant.breakaway *= level;
        y.control = control(&y.plant, &x.control, slower);
        machine.axes = [x, y];
        // Two of three screws have some of the inertia between their ends.
        if !seed.is_multiple_of(3) {
            let mut screws = random(seed, 3);
            for AxisDesign { plant, .. } in &mut machine.axes {
                let [least, most] = screw_shares(plant);
                plant.screw_share = log_uniform(&mut screws, 0.01, 0.08).min(most).max(least);
            }
        }
        machine
    }
}

/// An axis that could be bought: 60 to 800 kg on a screw of 5 to 20 mm, 45 to 160 Hz, friction of 50 to 900 N; and
/// how many times slower than the rest its integral acts.
fn drawn_axis(source: &mut Random) -> (AxisDesign, f64) {
    let lead = [0.005, 0.01, 0.012, 0.016, 0.02][source.random_range(0..5)];
    let mass = log_uniform(source, 60.0, 800.0);
    let travel = lead / TAU;
    let efficiency = source.random_range(0.85..0.95);
    // The motor fits its load: its own inertia is 0.7 to 4 times what the table adds.
    let reflected = mass * travel * travel / efficiency;
    let inertia = (reflected * log_uniform(source, 0.7, 4.0)).max(4e-4);
    let resonance = log_uniform(source, 45.0, 160.0);
    let stiffness = mass * (TAU * resonance).powi(2);
    let damping = 2.0 * source.random_range(0.04..0.2) * (stiffness * mass).sqrt();
    let sliding = log_uniform(source, 0.4, 3.0) * mass;
    let sliding = sliding.clamp(50.0, 900.0);
    // A half of them has rolling guides without a fall, the others slide.
    let fall = if source.random_bool(0.5) { 1.0 } else { source.random_range(1.05..1.3) };
    let fall_end = log_uniform(source, 0.3e-3, 3e-3);
    let viscous = if source.random_bool(0.5) { 0.0 } else { sliding * source.random_range(1.0..6.0) };
    // The hardest acceleration takes no more than three quarters of the current.
    let hardest = (inertia + reflected) * 4.5 / travel + 1.3 * sliding * travel / efficiency;
    let plant = Plant {
        mass,
        stiffness,
        damping,
        inertia,
        screw_share: 0.0,
        lead,
        efficiency,
        torque_constant: log_uniform(source, 0.4, 1.6).max(hardest / (0.75 * CURRENT_MAX)),
        current_loop_hz: log_uniform(source, 200.0, 1000.0),
        breakaway: sliding * fall,
        sliding,
        fall_start: fall_end * source.random_range(0.1..0.4),
        fall_end,
        viscous,
    };
    let is_immediate = source.random_bool(0.3);
    let settings = Control {
        position_gain: log_uniform(source, 15.0, 60.0),
        velocity_feed_forward: [0.0, 0.0, 0.6][source.random_range(0..3)],
        proportional: 0.0,
        integral: 0.0,
        current_max: CURRENT_MAX,
        delay: if is_immediate { 0.0 } else { 5e-4 },
        is_second_order: source.random_bool(0.5),
    };
    let slower = source.random_range(4.0..8.0);
    let control = control(&plant, &settings, slower);
    (AxisDesign { plant, control, sensors: sensors(source, &plant) }, slower)
}

/// Shares of the inertia that a screw may have: with less it would come to rest between its dampers faster than the
/// integration can follow, with more it would swing between its springs slowly enough to be an effect of its own.
fn screw_shares(plant: &Plant) -> [f64; 2] {
    const FASTEST_PER_S: f64 = 4e4;
    const SLOWEST_RAD_PER_S: f64 = TAU * 300.0;
    let mobility = plant.travel_per_rad() * plant.torque_per_force() / plant.inertia;
    let springs = 4.0 * plant.stiffness * mobility;
    [4.0 * plant.damping * mobility / FASTEST_PER_S, springs / SLOWEST_RAD_PER_S.powi(2)]
}

/// Gains for a plant: the velocity loop crosses at 32 Hz or 0.6 of the table's resonance on a standing screw, the
/// integral acts `slower`, the position loop at least five times slower.
fn control(plant: &Plant, like: &Control, slower: f64) -> Control {
    let crossing = (TAU * 32.0).min(0.6 * (plant.stiffness / plant.mass).sqrt());
    let proportional = plant.inertia_total() * crossing;
    Control {
        position_gain: like.position_gain.min(crossing / 5.0),
        proportional,
        integral: proportional * crossing / slower,
        ..*like
    }
}

/// Sensors between very good and ordinary: counts of 1 nm to 1 um, current noise of some thousandths to two hundredths
/// of what the axis works with. What repeats no better than a real axis does are torque and table: half a per cent to
/// three of the friction, 20 to 200 nm; without them effects of nanometres would count as seen.
fn sensors(source: &mut Random, plant: &Plant) -> Sensors {
    let friction = plant.sliding * plant.torque_per_force();
    let working = (friction + plant.inertia_total() / plant.travel_per_rad()) / plant.torque_constant;
    Sensors {
        // Whole counts per turn and per millimetre.
        motor_count: plant.lead / (plant.lead / log_uniform(source, 1e-9, 1e-6)).round(),
        table_count: 1e-3 / (1e-3 / log_uniform(source, 1e-9, 1e-6)).round(),
        table_noise: log_uniform(source, 20e-9, 0.2e-6),
        table_noise_time: log_uniform(source, 2e-3, 0.2),
        current_noise: working * log_uniform(source, 3e-3, 2e-2),
        current_noise_time: log_uniform(source, 0.3e-3, 5e-3),
        torque_noise: friction * log_uniform(source, 5e-3, 3e-2),
        torque_noise_time: log_uniform(source, 5e-3, 60e-3),
        latch_jitter: if source.random_bool(0.3) { source.random_range(0.2e-6..2e-6) } else { 0.0 },
    }
}

/// Two laps of a circle, radius in m and feed in m/s.
fn circle(radius: f64, feed: f64, is_ccw: bool, is_held_out: bool) -> Run {
    let way = if is_ccw { "ccw" } else { "cw" };
    let role = if is_held_out { "heldout" } else { "circle" };
    let name = format!("{role}-r{:.0}-f{:.0}-{way}", 1e3 * radius, feed / MM_PER_MIN);
    Run { name, motion: Motion::Circle { radius, feed, is_ccw, laps: 2 }, is_held_out }
}

/// The runs: two circles both ways, a sweep, micro-reversals, accelerations, and two circles to judge by.
fn runs(source: &mut Random) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut circle = |radius_mm: f64, feed: f64, is_ccw: bool, is_held_out: bool| {
        let feed = (feed / 50.0).round() * 50.0 * MM_PER_MIN;
        runs.push(circle(1e-3 * radius_mm, feed, is_ccw, is_held_out));
    };
    let slow = source.random_range(1000.0..1600.0);
    let fast = source.random_range(3000.0..4000.0);
    for is_ccw in [true, false] {
        circle(10.0, slow, is_ccw, false);
        circle(20.0, fast, is_ccw, false);
    }
    let (middle, small) = (source.random_range(1800.0..2600.0), source.random_range(900.0..1500.0));
    circle(15.0, middle, true, true);
    circle(8.0, small, false, true);
    let top = source.random_range(0.09..0.15);
    let speeds = (0..6).map(|n| 1e-3 * (top / 1e-3_f64).powf(f64::from(n) / 5.0)).collect();
    let run = |name: &str, motion| Run { name: name.to_owned(), motion, is_held_out: false };
    runs.insert(4, run("sweep", Motion::Sweep { speeds, laps: 2 }));
    let amplitudes = vec![5e-6, 30e-6, 200e-6, 1e-3];
    runs.insert(5, run("micro-reversals", Motion::MicroReversals { amplitudes, laps: 2 }));
    let accelerations = [source.random_range(1.5..2.5), source.random_range(3.0..4.5)];
    let motion = Motion::Acceleration { distances: [40e-3, 15e-3], accelerations, laps: 2 };
    runs.insert(6, run("acceleration", motion));
    runs
}
