//! One axis of a rack: its board outside, its plant inside, and the sensors between them.
//!
//! Whoever holds the rack says how time passes: [`Axis::step`] moves the plant on by one step,
//! [`Axis::hear`] gives a frame to the board, SYNC among them, at a moment since the last step.
//! Invariant: the board learns of the plant only what its sensors show.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;

use super::board::{Board, Measured};
use super::script::{Effect, Kind};
use super::truth::AxisTruth;
use crate::base::axis::PerAxis;
use crate::base::time::{Moment, Span};
use crate::base::units::{Current, Position};
use crate::plant::encoder::{Knot, Latch};
use crate::plant::{self, Plant};
use crate::rt::bus::Frame;
use crate::rt::drive::sheet::Sheet;
use crate::rt::wire::scaling::{AxisScale, CurrentCounts, EncoderCounts};
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
    /// What the plant is by now; a script may have made it differ from the settings.
    parameters: plant::Parameters,
    motor: Latch,
    table: Latch,
    noise: Option<Normal<f64>>,
    random: Pcg64Mcg,
    /// What its table scale shows too much for what the next axis does.
    crossing: Position,
}

/// A frame comes. At a SYNC so long `after` the end of the last step, the next axis pushes and shows in table scales; after the
/// last comes the first.
pub(super) fn cross(axes: &mut [Axis], frame: &Frame, after: Span) {
    let is_latched = Address::of(frame.id()) == Some(Address::Sync);
    if !is_latched || axes.len() < 2 || !axes.iter().any(|axis| axis.plant.is_crossed()) {
        return;
    }
    let neighbours = PerAxis::from_fn(axes.len(), |id| {
        let axis = &axes[id.index()];
        axis.plant.neighbour(axis.table.position(after))
    });
    let neighbours = neighbours.as_slice();
    for (index, axis) in axes.iter_mut().enumerate() {
        axis.crossing = axis.plant.crossed(&neighbours[(index + 1) % neighbours.len()]);
    }
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
        let parameters = settings.plant;
        Self {
            settings: *settings,
            board: Board::new(node, layout, sheet, serial, motor, table, now),
            plant: Plant::with_fine_steps(&parameters, step, fine_steps),
            parameters,
            motor: Latch::new(feedback_latency, step),
            table: Latch::new(feedback_latency, step),
            noise: Normal::new(0.0, settings.current_noise.as_a()).ok().filter(|noise| noise.std_dev() > 0.0),
            random,
            crossing: Position::ZERO,
        }
    }

    /// Current that the board gives now.
    pub(super) fn current(&self) -> Current {
        self.settings.scale.current(self.board.current_to_apply())
    }

    /// Node and layout of its board.
    pub(super) const fn address(&self) -> (Node, Layout) {
        (self.settings.node, self.settings.layout)
    }

    /// What it really does, so long `after` the end of the last step.
    pub(super) fn truth(&self, after: Span) -> AxisTruth {
        let state = self.plant.state();
        AxisTruth {
            position: self.motor.position(after),
            motor_velocity: state.motor_velocity,
            table_velocity: state.table_velocity,
            current: self.current(),
        }
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
        let [motor, table] = self.plant.shown(self.motor.position(after), self.table.position(after));
        let measured = Measured {
            motor: scale.motor_counts(motor),
            table: scale.table_counts(table + self.crossing),
            current: scale.current_counts(self.plant.state().current + Current::a(noise_a)),
        };
        self.board.latch(cycle, measured, at);
    }

    /// A fault begins.
    pub(super) fn begin(&mut self, effect: &Effect, now: Moment) {
        let AxisSettings { scale, plant: original, .. } = self.settings;
        match *effect {
            Effect::EncoderFrozen => self.board.set_encoder_frozen(true),
            Effect::EncoderError => self.board.set_encoder_error(true),
            Effect::EncoderJump(way) => self.board.jump_encoder(scale.motor_counts(way)),
            Effect::EncoderWrap(way) => {
                self.board.place_before_wrap(scale.motor_counts(way), scale.table_counts(way));
            }
            Effect::SilentBoard => self.board.set_silent(true),
            Effect::BoardReset => self.board.reset(now),
            Effect::BoardPowerCycle => self.board.power_cycle(now),
            Effect::BoardBusOff => self.board.set_off_bus(true),
            Effect::DriveFault(code) => self.board.trip_drive(code, 0),
            Effect::CurrentSaturation(most) => {
                // The sign of the counts is the sense of the encoder, not of the limit.
                let counts = CurrentCounts::ua(scale.current_counts(most).as_ua().saturating_abs());
                self.board.limit_current(Some(counts));
            }
            Effect::WrongIdentity(product) => {
                self.board.reprogram(Sheet { product, ..self.settings.sheet });
            }
            Effect::WrongFirmwareConfig { watchdog_us } => {
                self.board.reprogram(Sheet { watchdog_us, ..self.settings.sheet });
            }
            Effect::Load(factor) => {
                self.parameters.mechanics.mass_kg = original.mechanics.mass_kg * factor;
                self.plant.change(&self.parameters);
            }
            Effect::Friction(factor) => {
                self.parameters.friction = original.friction.scaled(factor);
                self.plant.change(&self.parameters);
            }
            Effect::Backlash(width) => {
                self.parameters.mechanics.backlash_m = width.as_m();
                self.plant.change(&self.parameters);
            }
            Effect::LostFrames(_)
            | Effect::LateFrames { .. }
            | Effect::RepeatedFrames(_)
            | Effect::ReorderedFrames(_)
            | Effect::CorruptedFrames(_)
            | Effect::SecondHost(_)
            | Effect::ControllerBusOff
            | Effect::ControllerErrorPassive => {}
        }
    }

    /// A fault that lasts ends; what happened at once stays.
    pub(super) fn end(&mut self, effect: &Effect) {
        match effect.kind() {
            Kind::EncoderFrozen => self.board.set_encoder_frozen(false),
            Kind::EncoderError => self.board.set_encoder_error(false),
            Kind::SilentBoard => self.board.set_silent(false),
            Kind::BoardBusOff => self.board.set_off_bus(false),
            Kind::CurrentSaturation => self.board.limit_current(None),
            _ => {}
        }
    }
}
