//! One axis of a rack: its board outside, its plant inside, and the sensors between them.
//!
//! Whoever holds the rack says how time passes: [`Axis::step`] moves the plant on by one step,
//! [`Axis::hear`] gives a frame to the board, SYNC among them, at a moment since the last step.
//! Invariant: the board learns of the plant only what its sensors show.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;

use super::board::{Board, Measured};
use crate::base::time::{Moment, Span};
use crate::base::units::Current;
use crate::plant::encoder::{Knot, Latch};
use crate::plant::{self, Plant};
use crate::rt::bus::Frame;
use crate::rt::drive::sheet::Sheet;
use crate::rt::wire::scaling::{AxisScale, EncoderCounts};
use crate::rt::wire::{Address, Layout, Node, command};

/// One axis of a rack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisSettings {
    /// Number of its board.
    pub node: Node,
    /// How its cyclic frames travel.
    pub layout: Layout,
    /// What its board runs with.
    pub sheet: Sheet,
    /// Counts of its encoders.
    pub scale: AxisScale,
    /// Age of the latched encoders at the SYNC.
    pub feedback_latency: Span,
    /// Noise of the current measurement, rms.
    pub current_noise: Current,
    /// Mechanics, friction, actuator.
    pub plant: plant::Parameters,
}

/// How the plant of an axis is stepped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stepping {
    pub(super) step: Span,
    /// Parts of a step while the table creeps or sticks.
    pub(super) fine_steps: u32,
}

/// A board, its plant and the sensors.
#[derive(Debug)]
pub(super) struct Axis {
    settings: AxisSettings,
    pub(super) board: Board,
    plant: Plant,
    motor: Latch,
    table: Latch,
    noise: Option<Normal<f64>>,
    random: Pcg64Mcg,
}

impl Axis {
    /// An axis at rest whose board gets power at `now`. The seed decides where the encoders' counters
    /// stand and what the noise is.
    pub(super) fn new(settings: &AxisSettings, stepping: Stepping, seed: u64, now: Moment) -> Self {
        let AxisSettings { node, layout, sheet, feedback_latency, .. } = *settings;
        let Stepping { step, fine_steps } = stepping;
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let [motor, table] = [(); 2].map(|()| EncoderCounts::counts(random.random()));
        let serial = random.random();
        Self {
            settings: *settings,
            board: Board::new(node, layout, sheet, serial, motor, table, now),
            plant: Plant::with_fine_steps(&settings.plant, step, fine_steps),
            motor: Latch::new(feedback_latency, step),
            table: Latch::new(feedback_latency, step),
            noise: Normal::new(0.0, settings.current_noise.as_a()).ok().filter(|noise| noise.std_dev() > 0.0),
            random,
        }
    }

    /// Current that the board gives now.
    pub(super) fn current(&self) -> Current {
        self.settings.scale.current(self.board.current_to_apply())
    }

    /// What the axis really does.
    pub(super) fn state(&self) -> plant::State {
        self.plant.state()
    }

    /// A step with a current is over at `now`.
    pub(super) fn step(&mut self, current: Current, now: Moment) {
        self.plant.step(current);
        let state = self.plant.state();
        self.motor.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
        self.table.feed(Knot { position: state.table_position, velocity: state.table_velocity });
        self.board.advance(now);
    }

    /// A frame comes to the board at the moment `at`, so long `after` the end of the last step.
    pub(super) fn hear(&mut self, frame: &Frame, at: Moment, after: Span) {
        match Address::of(frame.id()) {
            Some(Address::Sync) => {
                if let Ok(cycle) = command::decode_sync(frame) {
                    self.latch(cycle, at, after);
                }
            }
            Some(_) | None => self.board.hear(frame, at),
        }
    }

    fn latch(&mut self, cycle: u32, at: Moment, after: Span) {
        let scale = &self.settings.scale;
        let noise_a = self.noise.map_or(0.0, |noise| noise.sample(&mut self.random));
        let measured = Measured {
            motor: scale.motor_counts(self.motor.position(after)),
            table: scale.table_counts(self.table.position(after)),
            current: scale.current_counts(self.plant.state().current + Current::a(noise_a)),
        };
        self.board.latch(cycle, measured, at);
    }
}
