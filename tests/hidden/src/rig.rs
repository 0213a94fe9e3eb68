//! A machine that runs: both axes step by step, their controllers period by period, and what the sensors say.
//!
//! In a period: latch the encoders, read the current, let the controllers think, then move the axes in fine steps. A
//! command acts after its delay, also within a period, where a step has a part of the old and a part of the new one.
//! Invariant: the same machine, features, seed and setpoints give the same rows to the bit.

use rand_distr::{Distribution, StandardNormal};

use crate::axis::{Axis, CURRENT, MOTOR, MOTOR_SPEED, Push, TABLE, TABLE_SPEED};
use crate::controller::{Controller, PERIOD, Setpoint};
use crate::features::Features;
use crate::machine::{AxisDesign, Machine, Random, random};
use crate::plant::{Plant, Sensors};

/// Steps of the integration in a period: 20 us. Halving them changes a protrusion by less than a nanometre.
pub const STEPS: usize = 25;

/// What one axis says in one period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Setpoint, m.
    pub setpoint: f64,
    /// Motor encoder as travel, m.
    pub position: f64,
    /// Table scale, m.
    pub table: f64,
    /// Current, A.
    pub current: f64,
}

/// A row of a trace: x and y.
pub type Row = [Reading; 2];

/// Something that happens once: somebody leans on the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bump {
    /// From and until, s in the run.
    pub span: [f64; 2],
    /// N on the table, by axis.
    pub force: [f64; 2],
}

/// What a run is made with, beside machine and features.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Seed of the noise; `None`: no noise, and sensors without counts.
    pub noise: Option<u64>,
    /// Of the session, at the run's begin, s.
    pub start: f64,
    /// Steps of the integration in a period.
    pub steps: usize,
    /// Something that happens once.
    pub bump: Option<Bump>,
    /// Wander of current and scale with the session: A/s and m/s, by axis.
    pub drift: [[f64; 2]; 2],
}

impl Conditions {
    /// Without any disturbance.
    pub const QUIET: Self = Self { noise: None, start: 0.0, steps: STEPS, bump: None, drift: [[0.0; 2]; 2] };
}

/// Noise with a memory: `n += (white - n) T / time`, scaled to its rms.
#[derive(Clone, Debug)]
struct Coloured {
    keep: f64,
    drive: f64,
    value: f64,
}

impl Coloured {
    fn new(rms: f64, time: f64, source: &mut Random) -> Self {
        let keep = (-PERIOD / time).exp();
        let start: f64 = StandardNormal.sample(source);
        Self { keep, drive: rms * (1.0 - keep * keep).sqrt(), value: rms * start }
    }

    fn next(&mut self, source: &mut Random) -> f64 {
        let white: f64 = StandardNormal.sample(source);
        self.value = self.keep * self.value + self.drive * white;
        self.value
    }
}

/// One axis of the rig.
struct Station {
    axis: Axis,
    controller: Controller,
    features: Features,
    sensors: Sensors,
    /// From the latch to the current, s.
    delay: f64,
    /// Commands, the newest first.
    commands: Vec<f64>,
    torque_noise: Coloured,
    current_noise: Coloured,
    table_noise: Coloured,
    /// Where the scale's head is in its play.
    head: f64,
    /// What accelerates the table, N, in the mean of the last step.
    accelerating: f64,
}

impl Station {
    fn new(
        design: &AxisDesign,
        told: &Plant,
        features: &Features,
        place: f64,
        t: f64,
        source: &mut Random,
    ) -> Self {
        let AxisDesign { plant, control, sensors } = design;
        let delay = control.delay + features.motor.delay;
        Self {
            table_noise: Coloured::new(sensors.table_noise, sensors.table_noise_time, source),
            // The loop has come to rest: it is the reading that is at the setpoint.
            axis: Axis::new(plant, features, place - features.reading.motor_error(place), t),
            controller: Controller::new(
                control,
                &features.loops,
                told.torque_constant,
                plant.travel_per_rad(),
            ),
            features: *features,
            sensors: *sensors,
            delay,
            commands: vec![0.0; (delay / PERIOD).ceil() as usize + 2],
            torque_noise: Coloured::new(sensors.torque_noise, sensors.torque_noise_time, source),
            current_noise: Coloured::new(sensors.current_noise, sensors.current_noise_time, source),
            head: place,
            accelerating: 0.0,
        }
    }

    /// What the axis beside it, with these features, is crossed with, N.
    fn crosses_with(&self, beside: &Features, t: f64) -> f64 {
        if beside.is_crossed_by_inertia { self.accelerating } else { self.axis.screw_force(t) }
    }

    /// The command that flows in a step that goes from `from` to `to` (both s since the latch), in the mean.
    fn flowing(&self, from: f64, to: f64) -> f64 {
        let age = self.delay - from;
        if age <= 0.0 {
            return self.commands[0];
        }
        let older = (age / PERIOD).ceil() as usize;
        let switch = self.delay - (older - 1) as f64 * PERIOD;
        let (old, new) = (self.commands[older], self.commands[older - 1]);
        if switch >= to { old } else { new + (old - new) * (switch - from) / (to - from) }
    }
}

/// To the next count; a count of zero is no count.
fn counted(value: f64, count: f64) -> f64 {
    if count > 0.0 { (value / count).round() * count } else { value }
}

/// Run setpoints on a machine; `told` is what its controllers believe of its axes.
pub fn run(
    machine: &Machine,
    told: &[Plant; 2],
    features: &[Features; 2],
    setpoints: &[[Setpoint; 2]],
    conditions: &Conditions,
) -> Vec<Row> {
    let mut source = random(conditions.noise.unwrap_or(0), 3);
    let mut stations: [Station; 2] = std::array::from_fn(|n| {
        let place = setpoints[0][n].place;
        Station::new(&machine.axes[n], &told[n], &features[n], place, conditions.start, &mut source)
    });
    let step = PERIOD / conditions.steps as f64;
    let mut rows = Vec::with_capacity(setpoints.len());
    for number in 0..setpoints.len() {
        let since = number as f64 * PERIOD;
        let t = conditions.start + since;
        let is_noisy = conditions.noise.is_some();
        let forces: [f64; 2] = std::array::from_fn(|n| stations[n].crosses_with(&features[1 - n], t));
        let tables: [f64; 2] = std::array::from_fn(|n| stations[n].axis.state()[TABLE]);
        let mut row = Row::default();
        for (n, station) in stations.iter_mut().enumerate() {
            row[n].setpoint = setpoints[number][n].place;
            let others = [tables[1 - n], forces[1 - n]];
            latch(station, &mut row[n], others, is_noisy.then_some(&mut source));
            let wanted = wanted(setpoints, number, n, &station.features);
            let command = station.controller.step(number as u64, wanted, row[n].position);
            station.commands.rotate_right(1);
            station.commands[0] = command;
            let [current, table] = conditions.drift[n];
            row[n].current += current * t;
            row[n].table += table * t;
        }
        rows.push(row);
        let pushes: [Push; 2] = std::array::from_fn(|n| {
            let station = &mut stations[n];
            let torque = if is_noisy { station.torque_noise.next(&mut source) } else { 0.0 };
            let leans = conditions.bump.filter(|bump| (bump.span[0]..bump.span[1]).contains(&since));
            Push { current: 0.0, torque, force: leans.map_or(0.0, |bump| bump.force[n]) }
        });
        for part in 0..conditions.steps {
            let from = part as f64 * step;
            let forces: [f64; 2] = std::array::from_fn(|n| {
                let is_pushed = features[n].train.pushed != 0.0;
                if is_pushed { stations[1 - n].crosses_with(&features[n], t + from) } else { 0.0 }
            });
            for (n, station) in stations.iter_mut().enumerate() {
                let push = Push {
                    current: station.flowing(from, from + step),
                    force: pushes[n].force + features[n].train.pushed * forces[n],
                    ..pushes[n]
                };
                let before = station.axis.state()[TABLE_SPEED];
                station.axis.advance(t + from, step, &push);
                let gained = station.axis.state()[TABLE_SPEED] - before;
                station.accelerating = machine.axes[n].plant.mass * gained / step;
            }
        }
    }
    rows
}

/// What encoders and current sensor of an axis say.
fn latch(station: &mut Station, reading: &mut Reading, others: [f64; 2], source: Option<&mut Random>) {
    let state = *station.axis.state();
    let (sensors, errors) = (&station.sensors, &station.features.reading);
    let (mut late, mut noise, mut shake, mut counts) = (0.0, 0.0, 0.0, [0.0; 2]);
    if let Some(source) = source {
        let jitter: f64 = StandardNormal.sample(source);
        late = sensors.latch_jitter * jitter;
        noise = station.current_noise.next(source);
        shake = station.table_noise.next(source);
        counts = [sensors.motor_count, sensors.table_count];
    }
    let motor = state[MOTOR] + late * state[MOTOR_SPEED];
    let position = motor + errors.motor_error(motor);
    let mut table = state[TABLE] + late * state[TABLE_SPEED];
    table += errors.table.from_home(table);
    let play = 0.5 * station.features.strange.loose_head;
    if play > 0.0 {
        station.head = station.head.clamp(table - play, table + play);
        table = station.head;
    }
    let [other_place, other_force] = others;
    table += errors.squareness * other_place + errors.tilt * other_force;
    reading.position = counted(position, counts[0]);
    reading.table = counted(table + shake, counts[1]);
    reading.current = state[CURRENT] * (1.0 + errors.current_gain) + noise;
}

/// The setpoint that the controller gets: the logged one, unless somebody turned the override knob.
fn wanted(setpoints: &[[Setpoint; 2]], number: usize, axis: usize, features: &Features) -> Setpoint {
    let [share, from, to] = features.strange.override_dip;
    let since = number as f64 * PERIOD;
    if share == 0.0 || !(from..to).contains(&since) {
        return setpoints[number][axis];
    }
    // It falls behind, and has caught up at the end.
    let through = (since - from) / (to - from);
    let behind = share * (to - from) * (std::f64::consts::PI * through).sin().powi(2);
    let at = (number as f64 - behind / PERIOD).max(0.0);
    let (earlier, part) = (at.floor() as usize, at.fract());
    let later = (earlier + 1).min(setpoints.len() - 1);
    let [a, b] = [setpoints[earlier][axis], setpoints[later][axis]];
    Setpoint { place: a.place + part * (b.place - a.place), speed: a.speed + part * (b.speed - a.speed) }
}
