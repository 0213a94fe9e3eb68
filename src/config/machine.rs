//! One machine: everything that its file says, checked, in the types that use it.
//!
//! Invariant: a [`Machine`] exists only after every check of its file has passed.

use std::collections::BTreeMap;

use crate::base::axis::{AxisId, PerAxis};
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Velocity};
use crate::plant;
use crate::rt::control;
pub use crate::rt::control::Gains;
use crate::rt::control::velocity_pi::{self, Memory};
use crate::rt::cycle::bucket::BucketLimit;
use crate::rt::cycle::mode::Patience;
use crate::rt::drive::sheet::Sheet;
use crate::rt::drive::velocity::VelocityEstimate;
use crate::rt::thread;
use crate::rt::wire::scaling::AxisScale;
use crate::rt::wire::{Layout, Node};

/// Names that axes can have, by number.
pub const AXIS_NAMES: [&str; 3] = ["x", "y", "z"];

/// A checked machine file.
#[derive(Clone, Debug)]
pub struct Machine {
    /// What it calls itself.
    pub name: String,
    /// Where it came from: a path, or `(embedded)`.
    pub source: String,
    /// The text, as the log carries it.
    pub text: String,
    /// Texts of the board sheets it names, as the log carries them.
    pub sheets: BTreeMap<String, String>,
    /// The control cycle.
    pub cycle: Cycle,
    /// How its thread is scheduled.
    pub real_time: thread::Settings,
    /// The CAN bus.
    pub bus: BusSettings,
    /// When silence and misses become faults.
    pub supervision: Supervision,
    /// Speeds of motions that nobody specified further.
    pub motion: Motion,
    /// Gain sets by number, the same on each axis.
    pub gain_sets: Vec<String>,
    /// The axes.
    pub axes: PerAxis<Axis>,
}

/// The control cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cycle {
    /// Period, `T_v`.
    pub period: Span,
    /// The position loop acts in each so many cycles.
    pub position_every: u32,
    /// From the SYNC to the last moment at which feedback counts as fresh.
    pub reply_window: Span,
}

/// The CAN bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusSettings {
    /// How the cyclic frames travel.
    pub layout: Layout,
    /// Bit rate of arbitration, bit/s.
    pub nominal_bit_per_s: u32,
    /// Bit rate of the data phase, bit/s.
    pub data_bit_per_s: u32,
}

/// When silence and misses become faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervision {
    /// Cycles without fresh feedback that are borne.
    pub stale_cycles_max: u32,
    /// Longest silence between heartbeats.
    pub heartbeat_timeout: Span,
    /// How long enabling and stopping may take.
    pub patience: Patience,
    /// Periods skipped at once that are borne.
    pub pause_cycles_max: u32,
    /// How many missed periods are borne.
    pub overruns: BucketLimit,
    /// How much missed feedback and how many unusable frames of a board are borne.
    pub losses: BucketLimit,
}

/// Speeds of motions that nobody specified further.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Between tests.
    pub positioning_feed: Velocity,
    /// Along any path.
    pub path_acceleration: Acceleration,
}

/// One axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Number of its board on the bus.
    pub node: Node,
    /// What must be true inside the board.
    pub sheet: Sheet,
    /// Counts to quantities.
    pub scale: AxisScale,
    /// Age of the latched encoders at the SYNC.
    pub feedback_latency: Span,
    /// How the motor's velocity is estimated.
    pub velocity_estimate: VelocityEstimate,
    /// Noise of the current measurement in simulation, rms.
    pub current_noise: Current,
    /// Mechanics, friction, actuator.
    pub plant: plant::Parameters,
    /// How the paper's `V_p` and `V_i` became the gains of its velocity loop.
    pub velocity_form: VelocityForm,
    /// Loops and limits. Its own plant parameters equal `plant` unless somebody makes them differ.
    pub control: control::Settings,
}

/// Eq. (5) of the paper, `a V_p (1 + b V_i / (t s + 1))`, in its two readings: how `V_p` and `V_i`, which have no
/// units there, become gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VelocityForm {
    /// `t` is long against the loop: a true integrator.
    Integrator {
        /// `a`, N m s/rad.
        a_nm_s_per_rad: f64,
        /// `b/t`, 1/s.
        b_per_t_per_s: f64,
    },
    /// As printed.
    Lag {
        /// `a`, N m s/rad.
        a_nm_s_per_rad: f64,
        /// `b`.
        b: f64,
        /// `t`, s.
        t_s: f64,
    },
}

impl VelocityForm {
    /// The gains of a pair of `V_p` and `V_i`.
    pub fn gains(&self, v_p: f64, v_i: f64) -> velocity_pi::Gains {
        match *self {
            Self::Integrator { a_nm_s_per_rad, b_per_t_per_s } => velocity_pi::Gains {
                proportional_nm_s_per_rad: a_nm_s_per_rad * v_p,
                memory: Memory::Integrator { gain_nm_per_rad: a_nm_s_per_rad * v_p * v_i * b_per_t_per_s },
            },
            Self::Lag { a_nm_s_per_rad, b, t_s } => velocity_pi::Gains {
                proportional_nm_s_per_rad: a_nm_s_per_rad * v_p,
                memory: Memory::Lag {
                    gain_nm_s_per_rad: a_nm_s_per_rad * v_p * b * v_i,
                    time_constant_s: t_s,
                },
            },
        }
    }

    /// The pair that gives these gains; `V_i` is not a number where the form has no integral part.
    pub fn pair(&self, gains: &velocity_pi::Gains) -> [f64; 2] {
        let kvp = gains.proportional_nm_s_per_rad;
        match (*self, gains.memory) {
            (Self::Integrator { a_nm_s_per_rad, b_per_t_per_s }, Memory::Integrator { gain_nm_per_rad }) => {
                [kvp / a_nm_s_per_rad, gain_nm_per_rad / kvp / b_per_t_per_s]
            }
            (Self::Lag { a_nm_s_per_rad, b, .. }, Memory::Lag { gain_nm_s_per_rad, .. }) => {
                [kvp / a_nm_s_per_rad, gain_nm_s_per_rad / kvp / b]
            }
            (Self::Integrator { .. } | Self::Lag { .. }, _) => [f64::NAN; 2],
        }
    }
}

impl Machine {
    /// Number of a gain set.
    pub fn gain_set(&self, name: &str) -> Option<u8> {
        self.gain_sets.iter().position(|set| set == name).map(|index| index as u8)
    }
    /// Names of the axes, in order.
    pub fn axis_names(&self) -> Vec<String> {
        self.axes.axes().map(|axis| AXIS_NAMES[axis.index()].to_owned()).collect()
    }
    /// Gains of an axis in a set.
    pub fn gains(&self, axis: AxisId, set: u8) -> &Gains {
        &self.axes[axis].control.gain_sets[usize::from(set)]
    }
    /// The same machine without friction at its tables, and with a control that knows it: a feed-forward
    /// against friction that is not there would push the twin a protrusion is measured against.
    pub fn without_friction(mut self) -> Self {
        for (_, axis) in self.axes.iter_mut() {
            axis.plant = axis.plant.without_friction();
            axis.control.axis = axis.control.axis.without_friction();
        }
        self
    }
}
