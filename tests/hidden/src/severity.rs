//! How strong an effect is, by its consequence: `d'`.
//!
//! The change that it makes in current, motor and table position is whitened by the repeat floor (what differs
//! between two sessions with other noise, as an autoregression of each channel) and freed of what the base parameters
//! could do instead: an oracle that knows the true machine fits them to the change on the runs for fitting, linearly
//! and with a prior of 30 %. What is left on the held-out runs, as the norm over all samples, is `d'`.
//!
//! So `d' = 6` is what an ideal observer just sees. It is linear in the base parameters, but not in the effect, which
//! is simulated at its size.
//! Invariant: no effect, no `d'`.

use rayon::prelude::*;

use crate::linear::{Whitening, solve};
use crate::machine::Machine;
use crate::plant::Plant;
use crate::rig::Row;
use crate::session::Session;

/// Steps in a period while searching: 50 us, a hundredth of the floor away from the fine ones.
pub const STEPS: usize = 10;
/// Current, motor encoder, table scale.
const CHANNELS: usize = 3;
/// Relative change of a base parameter for its column.
const CHANGE: f64 = 0.01;
/// Prior of a base parameter, relative.
const PRIOR: f64 = 0.3;

/// The base parameters of an axis, as changes of a plant by a share.
type Change = fn(&mut Plant, f64);

fn base_parameters(plant: &Plant) -> Vec<Change> {
    let mut changes: Vec<Change> = vec![
        |plant, share| plant.inertia *= 1.0 + share,
        |plant, share| plant.mass *= 1.0 + share,
        |plant, share| plant.stiffness *= 1.0 + share,
        |plant, share| plant.damping *= 1.0 + share,
        |plant, share| plant.torque_constant *= 1.0 + share,
        |plant, share| {
            plant.sliding *= 1.0 + share;
            plant.breakaway *= 1.0 + share;
        },
    ];
    if plant.breakaway > plant.sliding {
        changes.push(|plant, share| plant.breakaway *= 1.0 + share);
        changes.push(|plant, share| {
            plant.fall_start *= 1.0 + share;
            plant.fall_end *= 1.0 + share;
        });
    }
    if plant.viscous > 0.0 {
        changes.push(|plant, share| plant.viscous *= 1.0 + share);
    }
    if plant.screw_share > 0.0 {
        changes.push(|plant, share| plant.screw_share *= 1.0 + share);
    }
    changes
}

/// A whitened signal.
type White = Vec<f32>;

/// Whitened signals by axis, run and channel.
type Signals = Vec<Vec<Vec<White>>>;

/// What the severity of effects on a machine is measured by.
pub struct Yardstick {
    base: Vec<Vec<Row>>,
    whitening: Vec<Vec<Whitening>>,
    /// By parameter.
    columns: Vec<Signals>,
    is_held_out: Vec<bool>,
}

/// What of a case counts.
#[derive(Clone, Debug)]
pub struct Visible {
    /// There is a table scale.
    pub has_table: bool,
    /// The runs that are there.
    pub runs: Vec<bool>,
}

fn value(row: &Row, axis: usize, channel: usize) -> f64 {
    let reading = &row[axis];
    [reading.current, reading.position, reading.table][channel]
}

fn difference(a: &[Row], b: &[Row], axis: usize, channel: usize) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| value(a, axis, channel) - value(b, axis, channel)).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    // In pieces, so that single precision loses nothing that matters.
    a.chunks(1024)
        .zip(b.chunks(1024))
        .map(|(a, b)| f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>()))
        .sum()
}

/// Whether a machine stayed where machines are; its loops may not bear an effect.
pub fn is_sane(rows: &[Row]) -> bool {
    rows.iter().flatten().all(|reading| reading.position.abs() < 1.0)
}

impl Yardstick {
    /// For a machine: a base session, two with noise, and one for each base parameter.
    pub fn new(machine: &Machine) -> Self {
        let quiet = |machine: &Machine| Session::quiet(machine, Default::default(), STEPS).run();
        let noisy = |seed: u64| {
            Session { noise: Some(seed), ..Session::quiet(machine, Default::default(), STEPS) }.run()
        };
        let changes = base_parameters(&machine.axes[0].plant);
        let (base, (one, other)) = rayon::join(|| quiet(machine), || rayon::join(|| noisy(11), || noisy(12)));
        let whitening = (0..2)
            .map(|axis| {
                let channel = |channel| {
                    let runs =
                        one.iter().zip(&other).map(|(one, other)| difference(one, other, axis, channel));
                    Whitening::of_difference(&runs.collect::<Vec<_>>())
                };
                (0..CHANNELS).map(channel).collect()
            })
            .collect();
        let mut stick = Self {
            base,
            whitening,
            columns: Vec::new(),
            is_held_out: machine.runs.iter().map(|run| run.is_held_out).collect(),
        };
        let told = machine.axes.map(|axis| axis.plant);
        stick.columns = changes
            .par_iter()
            .map(|change| {
                let mut changed = machine.clone();
                changed.axes.iter_mut().for_each(|axis| change(&mut axis.plant, CHANGE));
                // The controllers stay as they are.
                let rows = Session { told, ..Session::quiet(&changed, Default::default(), STEPS) }.run();
                let mut column = stick.whitened(&rows);
                column.iter_mut().flatten().flatten().flatten().for_each(|value| *value /= CHANGE as f32);
                column
            })
            .collect();
        stick
    }

    /// What differs from the base session, whitened.
    fn whitened(&self, rows: &[Vec<Row>]) -> Signals {
        let signal = |axis: usize, run: usize, channel: usize| {
            self.whitening[axis][channel].apply(&difference(&rows[run], &self.base[run], axis, channel))
        };
        let runs = |axis| {
            (0..rows.len())
                .map(move |run| (0..CHANNELS).map(move |channel| signal(axis, run, channel)).collect())
        };
        (0..2).map(|axis| runs(axis).collect()).collect()
    }

    /// `d'` of a session without noise.
    pub fn severity(&self, rows: &[Vec<Row>], visible: &Visible) -> f64 {
        if !rows.iter().all(|rows| is_sane(rows)) {
            return f64::INFINITY;
        }
        let signals = self.whitened(rows);
        (0..2).map(|axis| self.severity_of(&signals[axis], axis, visible)).sum::<f64>().sqrt()
    }

    /// Square of the norm that the base parameters of an axis leave on its held-out runs.
    fn severity_of(&self, signals: &[Vec<White>], axis: usize, visible: &Visible) -> f64 {
        let count = self.columns.len();
        let channels = if visible.has_table { CHANNELS } else { CHANNELS - 1 };
        let (mut normal, mut right) = (vec![vec![0.0; count]; count], vec![0.0; count]);
        for (n, row) in normal.iter_mut().enumerate() {
            row[n] = PRIOR.powi(-2);
        }
        let (mut square, mut cross, mut gram) = (0.0, vec![0.0; count], vec![vec![0.0; count]; count]);
        for (run, signals) in signals.iter().enumerate() {
            if !visible.runs[run] {
                continue;
            }
            for (channel, signal) in signals.iter().enumerate().take(channels) {
                let held_out = self.is_held_out[run];
                if held_out {
                    square += dot(signal, signal);
                }
                for a in 0..count {
                    let column = &self.columns[a][axis][run][channel];
                    *(if held_out { &mut cross[a] } else { &mut right[a] }) += dot(column, signal);
                    for b in 0..=a {
                        let product = dot(column, &self.columns[b][axis][run][channel]);
                        let matrix = if held_out { &mut gram } else { &mut normal };
                        matrix[a][b] += product;
                        if a != b {
                            matrix[b][a] += product;
                        }
                    }
                }
            }
        }
        let fitted = solve(normal, right);
        let explained: f64 = (0..count).map(|a| fitted[a] * cross[a]).sum();
        let quadratic: f64 = (0..count)
            .flat_map(|a| (0..count).map(move |b| (a, b)))
            .map(|(a, b)| fitted[a] * fitted[b] * gram[a][b])
            .sum();
        (square - 2.0 * explained + quadratic).max(0.0)
    }
}
