//! All boards of a machine with their plants behind them, on one end of a bus.
//!
//! The rack lives by the SYNC: when the host sends the one of cycle `k`, every plant has moved on by
//! the periods since the last SYNC under the current of its board, and every board latches what its
//! sensors show. Between two SYNCs boards hear commands and parameter requests at the time of the last.
//! Invariant: its time is the cycle number in the SYNC, so it is the same at any speed of the host.

use rand::RngExt;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;

use super::board::{Board, Measured};
use crate::base::axis::{AxisId, PerAxis};
use crate::base::time::{Moment, Span};
use crate::base::units::Current;
use crate::plant::encoder::{Knot, Latch};
use crate::plant::{self, Plant};
use crate::rt::bus::{Bus, Frame};
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

/// One axis: its board outside, its plant inside.
#[derive(Debug)]
struct RackAxis {
    settings: AxisSettings,
    board: Board,
    plant: Plant,
    motor: Latch,
    table: Latch,
    noise: Option<Normal<f64>>,
    random: Pcg64Mcg,
}

/// The boards and plants of a machine.
#[derive(Debug)]
pub struct Rack {
    period: Span,
    now: Moment,
    last_cycle: Option<u32>,
    axes: Vec<RackAxis>,
}

impl Rack {
    /// A machine at rest, powered on at moment zero. The seed decides where the encoders' counters
    /// stand and what the noise is.
    pub fn new(period: Span, axes: &PerAxis<AxisSettings>, seed: u64) -> Self {
        let axes = axes
            .iter()
            .map(|(id, settings)| RackAxis::new(settings, period, seed.wrapping_add(id.index() as u64)))
            .collect();
        Self { period, now: Moment::ZERO, last_cycle: None, axes }
    }

    /// Hear all frames that wait at this end of the bus, and put the answers on it.
    pub fn serve(&mut self, bus: &mut impl Bus) {
        while let Some(received) = bus.receive(self.now) {
            self.hear(&received.frame);
            for axis in &mut self.axes {
                while let Some(answer) = axis.board.speak() {
                    // A full bus loses a frame, as a real one does; the host sees it missing.
                    let _lost = bus.send(&answer);
                }
            }
        }
    }

    fn hear(&mut self, frame: &Frame) {
        match Address::of(frame.id()) {
            Some(Address::Sync) => {
                if let Ok(cycle) = command::decode_sync(frame) {
                    self.sync(cycle);
                }
            }
            Some(_) | None => self.axes.iter_mut().for_each(|axis| axis.board.hear(frame, self.now)),
        }
    }

    fn sync(&mut self, cycle: u32) {
        // A counter that has stood still or gone back is a repeated or late SYNC: no time has passed.
        let elapsed = self.last_cycle.map_or(0, |last| cycle.wrapping_sub(last) as i32).max(0);
        for _ in 0..elapsed {
            self.now = self.now + self.period;
            for axis in &mut self.axes {
                axis.step(self.now);
            }
        }
        self.last_cycle = Some(cycle);
        for axis in &mut self.axes {
            axis.latch(cycle, self.now);
        }
    }

    /// The board of an axis, to make it fail.
    pub fn board_mut(&mut self, axis: AxisId) -> &mut Board {
        &mut self.axes[axis.index()].board
    }

    /// What an axis really does.
    pub fn state(&self, axis: AxisId) -> plant::State {
        self.axes[axis.index()].plant.state()
    }
}

impl RackAxis {
    fn new(settings: &AxisSettings, period: Span, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let [motor, table] = [(); 2].map(|()| EncoderCounts::counts(random.random()));
        let serial = random.random();
        Self {
            settings: *settings,
            board: Board::new(
                settings.node,
                settings.layout,
                settings.sheet,
                serial,
                motor,
                table,
                Moment::ZERO,
            ),
            plant: Plant::new(&settings.plant, period),
            motor: Latch::new(settings.feedback_latency, period),
            table: Latch::new(settings.feedback_latency, period),
            noise: Normal::new(0.0, settings.current_noise.as_a()).ok().filter(|noise| noise.std_dev() > 0.0),
            random,
        }
    }

    fn step(&mut self, now: Moment) {
        let current = self.settings.scale.current(self.board.current_to_apply());
        self.plant.step(current);
        let state = self.plant.state();
        self.motor.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
        self.table.feed(Knot { position: state.table_position, velocity: state.table_velocity });
        self.board.advance(now);
    }

    fn latch(&mut self, cycle: u32, now: Moment) {
        let scale = &self.settings.scale;
        let noise_a = self.noise.map_or(0.0, |noise| noise.sample(&mut self.random));
        let measured = Measured {
            motor: scale.motor_counts(self.motor.position()),
            table: scale.table_counts(self.table.position()),
            current: scale.current_counts(self.plant.state().current + Current::a(noise_a)),
        };
        self.board.latch(cycle, measured, now);
    }
}
