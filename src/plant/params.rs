//! What one axis is made of: mechanics, friction and actuator, with the relations between its motor
//! side and its table side.
//!
//! Motor quantities are carried over to the table through the screw: with `r = lead / 2π`, a torque
//! `T` pushes with `η T / r` (Eq. 4), and an inertia `J` weighs `η J / r²`.
//! Invariant: a parameter's unit is in its name; who checks ranges is `config`.

use std::f64::consts::TAU;

use super::effects::control::Otherwise;
use super::effects::{Action, Effects, Entry, Values};
use super::friction;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Force, Position, Torque};

/// Screw, table and what turns them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mechanics {
    /// Mass of the table and what stands on it, `M_eq`, kg.
    pub mass_kg: f64,
    /// Stiffness of screw, nut and bearings, `K_eq`, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping between motor and table, `C_eq`, N s/m.
    pub damping_n_s_per_m: f64,
    /// Inertia of motor and screw, `J`, kg m².
    pub inertia_kg_m2: f64,
    /// Travel per turn of the screw, m.
    pub lead_m: f64,
    /// Efficiency of the screw, `η`.
    pub efficiency: f64,
    /// Play between screw and table, m.
    pub backlash_m: f64,
    /// Of the inertia of motor and screw, the share that its deflection carries along: `Σ J_j α_j (1 - α_j) / J`, where `α_j` of
    /// the compliance lies between the motor and a part `J_j` of the screw.
    pub carried_share: f64,
}

impl Mechanics {
    /// Travel per radian of the motor, m.
    pub fn travel_per_rad_m(&self) -> f64 {
        self.lead_m / TAU
    }
    /// Force on the table per torque of the motor, N/(N m) (Eq. 4).
    pub fn force_per_torque(&self) -> f64 {
        self.efficiency / self.travel_per_rad_m()
    }
    /// Motor and screw as a mass at the table, kg.
    pub fn motor_mass_kg(&self) -> f64 {
        self.inertia_kg_m2 * self.force_per_torque() / self.travel_per_rad_m()
    }
    /// What the deflection of the screw carries along, kg: so much less than both masses swing against each other.
    pub fn carried_kg(&self) -> f64 {
        self.carried_share * self.motor_mass_kg()
    }
    /// Most of it that leaves masses which can swing, as a share of motor and screw.
    pub fn carried_share_max(&self) -> f64 {
        const OF_SWINGING: f64 = 0.5;
        OF_SWINGING * self.mass_kg / (self.mass_kg + self.motor_mass_kg())
    }
    /// Inertia of motor, screw and table at the motor shaft, kg m².
    pub fn total_inertia_kg_m2(&self) -> f64 {
        self.inertia_kg_m2 + self.mass_kg * self.travel_per_rad_m() / self.force_per_torque()
    }
    /// Frequency at which motor and table swing against each other, Hz.
    pub fn resonance_hz(&self) -> f64 {
        let per_kg = 1.0 / self.mass_kg + 1.0 / self.motor_mass_kg();
        (self.stiffness_n_per_m * per_kg / (1.0 - self.carried_kg() * per_kg)).sqrt() / TAU
    }
    /// How far the screw winds up under a force on the table.
    pub fn wind_up(&self, force: Force) -> Position {
        Position::m(force.as_n() / self.stiffness_n_per_m)
    }
    /// Torque that balances a force on the table.
    pub fn torque_for_force(&self, force: Force) -> Torque {
        Torque::nm(force.as_n() / self.force_per_torque())
    }
    /// Force on the table that a torque balances.
    pub fn force_of_torque(&self, torque: Torque) -> Force {
        Force::n(torque.as_nm() * self.force_per_torque())
    }
    /// Acceleration of motor, screw and table together by a torque.
    pub fn acceleration_by_torque(&self, torque: Torque) -> Acceleration {
        Acceleration::m_per_s2(torque.as_nm() / self.total_inertia_kg_m2() * self.travel_per_rad_m())
    }
    /// Torque that accelerates motor, screw and table together.
    pub fn torque_for_acceleration(&self, acceleration: Acceleration) -> Torque {
        Torque::nm(self.total_inertia_kg_m2() * acceleration.as_m_per_s2() / self.travel_per_rad_m())
    }
}

/// From the current command to the torque at the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuator {
    /// Torque per current, `K_t`, N m/A.
    pub torque_constant_nm_per_a: f64,
    /// Bandwidth of the current loop, a first-order lag, Hz.
    pub current_loop_hz: f64,
    /// Time constant of a filter of the drive before it, a first-order lag, s; zero without one.
    pub filter_s: f64,
    /// Time from a command taking effect in the drive to the current loop seeing it.
    pub dead_time: Span,
    /// Largest current that the drive makes.
    pub peak_current: Current,
}

impl Actuator {
    /// Time constant of the current loop, s.
    pub fn lag_s(&self) -> f64 {
        1.0 / (TAU * self.current_loop_hz)
    }
    /// Torque that a current makes.
    pub fn torque(&self, current: Current) -> Torque {
        Torque::nm(current.as_a() * self.torque_constant_nm_per_a)
    }
    /// Current that makes a torque.
    pub fn current(&self, torque: Torque) -> Current {
        Current::a(torque.as_nm() / self.torque_constant_nm_per_a)
    }
}

/// One axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Screw and table.
    pub mechanics: Mechanics,
    /// Friction at the table.
    pub friction: friction::Parameters,
    /// Drive and motor.
    pub actuator: Actuator,
    /// What it has beyond the base model.
    pub effects: Effects,
}

impl Parameters {
    /// Acceleration of the motor by its strongest torque, with nothing to turn but itself: the screw is
    /// elastic, so for a moment the table is not there.
    pub fn motor_acceleration_max(&self) -> Acceleration {
        let torque_nm = self.actuator.torque(self.actuator.peak_current).as_nm();
        Acceleration::m_per_s2(
            torque_nm.abs() / (self.mechanics.inertia_kg_m2 * (1.0 - self.mechanics.carried_share))
                * self.mechanics.travel_per_rad_m(),
        )
    }
    /// What the control that moves it does otherwise than its file says.
    pub fn otherwise(&self) -> Otherwise {
        self.effects.otherwise()
    }
    /// The same axis without friction.
    #[must_use]
    pub fn without_friction(mut self) -> Self {
        self.friction = friction::Parameters::NONE;
        self.effects = self.effects.without_friction();
        self
    }
    /// The same axis with an effect of these values. One that is another value of a parameter adds to it; any other
    /// takes the place of what the axis had of it.
    #[must_use]
    pub fn with_effect(mut self, entry: &Entry, values: Values) -> Self {
        match entry.action {
            Action::Parameter(add) if values[0] != 0.0 => add(&values, &mut self),
            Action::Parameter(_) => {}
            _ => self.effects = self.effects.with(entry, values),
        }
        self
    }
    /// The same axis as the base model has it; parameters stay as effects made them.
    #[must_use]
    pub const fn without_effects(mut self) -> Self {
        self.effects = Effects::NONE;
        self
    }
}
