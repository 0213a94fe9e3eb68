//! The loops of one axis with one gain set, in the frequency domain, at the delays they really have.
//!
//! ```text
//!   velocity   L_v = C(z) · hold · command delay · motor/torque · feedback latency · estimate
//!   position   L_p = K_p / s · hold over T_p · T · feedback latency,   T = motor speed per command
//!   response   G   = (K_p + k_ff s) / s · hold over T_p · T / (1 + L_p)
//! ```
//!
//! `C` is the sampled Eq. (5) in either form, the hold of a command over a tick is
//! `(1 - exp(-s T_v)) / (s T_v)` (half a tick), a board may apply a command one tick later, dead time
//! and current loop are in the plant, and the estimate answers as `rt/drive/velocity` samples it.
//! Left out: the images of the spectrum around multiples of the sampling rate, which the plant's own
//! fall (below 1e-3 at 2 kHz) hides, and friction, which has no transfer function.
//! The feed-forwards of torque do not change the loops; in `G` the velocity loop does their work at
//! the speeds of a circle. Angular frequencies in rad/s.
//! Invariant: no formula of the plant or of a controller is repeated here.

use std::f64::consts::PI;

use nalgebra::Complex;

use super::margins::{self, Margins};
use crate::base::axis::AxisId;
use crate::base::units::{Current, Position, Torque, Velocity};
use crate::config::Machine;
use crate::config::machine::{Axis, Gains};
use crate::plant::friction::Law;
use crate::plant::response::{delay, motor_speed_per_torque};

/// Frequencies up to half the sampling rate at which noise is summed up.
const NOISE_STEPS: u32 = 256;

/// The loops of one axis with one gain set.
#[derive(Clone, Copy, Debug)]
pub struct Loops<'m> {
    machine: &'m Machine,
    axis: &'m Axis,
    gains: &'m Gains,
}

impl<'m> Loops<'m> {
    /// Loops of an axis with the gain set of a number.
    ///
    /// # Panics
    /// When the machine has no such axis or gain set.
    pub fn new(machine: &'m Machine, axis: AxisId, set: u8) -> Self {
        assert!(usize::from(set) < machine.gain_sets.len(), "no gain set {set}");
        Self::with_gains(machine, &machine.axes[axis], machine.gains(axis, set))
    }

    /// Loops of an axis that may be another than that of the machine, with gains that may be in none of its
    /// sets.
    pub const fn with_gains(machine: &'m Machine, axis: &'m Axis, gains: &'m Gains) -> Self {
        Self { machine, axis, gains }
    }

    /// Margins of the velocity loop.
    pub fn velocity_margins(&self) -> Margins {
        self.margins(|omega| self.velocity_open(omega), 1)
    }

    /// Margins of the position loop around it.
    pub fn position_margins(&self) -> Margins {
        self.margins(|omega| self.position_open(omega), self.machine.cycle.position_every)
    }

    /// Damping of the velocity loop without delays, around the inertia of motor and screw (the table
    /// hangs on a spring and is the paper's `J` no more than in its Eq. 7).
    pub fn damping(&self) -> f64 {
        self.gains.velocity.damping(self.axis.plant.mechanics.inertia_kg_m2)
    }

    /// The same around all that moves, as it is at low frequency.
    pub fn damping_with_table(&self) -> f64 {
        self.gains.velocity.damping(self.axis.plant.mechanics.total_inertia_kg_m2())
    }

    /// How much smaller than ordered a circle becomes at the motor, without friction: `R (1 - |G|)`.
    pub fn radius_decrease(&self, radius: Position, feed: Velocity) -> Position {
        let omega = feed.as_m_per_s() / radius.as_m();
        radius * (1.0 - self.response(omega).norm())
    }

    /// Setpoint minus measured position in steady motion. A velocity loop without a true integrator
    /// leaves a speed error under friction, which adds to it.
    pub fn following_error(&self, feed: Velocity) -> Position {
        let (gains, plant) = (self.gains, &self.axis.plant);
        let friction = plant.mechanics.torque_for_force(Law::new(plant.friction).sliding(feed));
        let left_nm = friction.as_nm() * (1.0 - gains.compensation.friction);
        let droop_m_per_s =
            left_nm / gains.velocity.gain_at_rest_nm_s_per_rad() * plant.mechanics.travel_per_rad_m();
        let behind_m_per_s = feed.as_m_per_s() * (1.0 - gains.position.velocity_feed_forward) + droop_m_per_s;
        Position::m(behind_m_per_s / gains.position.gain_per_s)
    }

    /// From motor position to force and back: all that delays the velocity loop but the current loop, s.
    pub fn dead_time_s(&self) -> f64 {
        let period = self.machine.cycle.period;
        let turn = 1e-3 / period.as_s();
        let estimate_s = -self.axis.velocity_estimate.response(period, turn).arg() / turn;
        let held_s = 0.5 * period.as_s() + self.axis.sheet.command_delay(period).as_s();
        held_s + self.axis.plant.actuator.dead_time.as_s() + self.axis.feedback_latency.as_s() + estimate_s
    }

    /// Current that the counts of the motor encoder make in the closed velocity loop, rms: each position is off
    /// by a chance share of a count, evenly, and independently of the one before.
    pub fn current_noise(&self) -> Current {
        let period = self.machine.cycle.period;
        let plant = &self.axis.plant;
        let share = |step: u32| {
            let omega = PI * (f64::from(step) + 0.5) / f64::from(NOISE_STEPS) / period.as_s();
            let velocity = self.axis.velocity_estimate.response(period, omega) * Complex::new(0.0, omega);
            let torque = velocity * self.gains.velocity.response(period, omega);
            (torque / (self.velocity_open(omega) + 1.0)).norm_sqr()
        };
        let mean = (0..NOISE_STEPS).map(share).sum::<f64>() / f64::from(NOISE_STEPS);
        let count_rms_m = self.axis.scale.motor_resolution().abs().as_m() / 12.0_f64.sqrt();
        let torque_nm = mean.sqrt() * count_rms_m / plant.mechanics.travel_per_rad_m();
        plant.actuator.current(Torque::nm(torque_nm))
    }

    /// Open velocity loop.
    pub fn velocity_open(&self, omega: f64) -> Complex<f64> {
        self.forward(omega) * self.seen(omega)
    }

    /// Open position loop.
    pub fn position_open(&self, omega: f64) -> Complex<f64> {
        self.travel_per_command(omega) * self.gains.position.gain_per_s * self.latency(omega)
    }

    /// Motor position per setpoint.
    pub fn response(&self, omega: f64) -> Complex<f64> {
        let position = &self.gains.position;
        let order = Complex::new(position.gain_per_s, position.velocity_feed_forward * omega);
        order * self.travel_per_command(omega) / (self.position_open(omega) + 1.0)
    }

    /// Margins of velocity loop and position loop, with what no gain changes already known.
    pub fn margins_on(&self, known: &Gainless) -> [Margins; 2] {
        let period = self.machine.cycle.period;
        let forward =
            |known: &Known| self.gains.velocity.response(period, known.omega) * known.behind_controller;
        let gain = self.gains.position.gain_per_s;
        let velocity = |known: &Known| forward(known) * known.seen;
        let position = |known: &Known| {
            let forward = forward(known);
            forward / (forward * known.seen + 1.0) * known.behind_velocity * gain
        };
        let [tick, position_tick] = &known.grids;
        [
            tick.margins(velocity, |omega| self.velocity_open(omega)),
            position_tick.margins(position, |omega| self.position_open(omega)),
        ]
    }

    fn margins(&self, open: impl Fn(f64) -> Complex<f64>, sampled_every: u32) -> Margins {
        let sample_s = self.machine.cycle.period.as_s() * f64::from(sampled_every);
        Margins::of(open, 1.0 / sample_s, self.axis.plant.mechanics.resonance_hz())
    }

    /// Motor speed per speed error.
    fn forward(&self, omega: f64) -> Complex<f64> {
        self.gains.velocity.response(self.machine.cycle.period, omega) * self.behind_controller(omega)
    }

    /// Motor speed per torque of the controller.
    fn behind_controller(&self, omega: f64) -> Complex<f64> {
        let period = self.machine.cycle.period;
        hold(period.as_s(), omega)
            * delay(self.axis.sheet.command_delay(period).as_s(), omega)
            * motor_speed_per_torque(&self.axis.plant, omega)
    }

    fn latency(&self, omega: f64) -> Complex<f64> {
        delay(self.axis.feedback_latency.as_s(), omega)
    }

    /// Motor speed as the velocity loop sees it.
    fn seen(&self, omega: f64) -> Complex<f64> {
        self.axis.velocity_estimate.response(self.machine.cycle.period, omega) * self.latency(omega)
    }

    /// Motor position per velocity command of the position loop: held over its ticks, then `T / s`.
    fn travel_per_command(&self, omega: f64) -> Complex<f64> {
        let forward = self.forward(omega);
        forward / (forward * self.seen(omega) + 1.0) * self.behind_velocity(omega)
    }

    /// Motor position per speed that the closed velocity loop makes of a held command.
    fn behind_velocity(&self, omega: f64) -> Complex<f64> {
        let tick_s = self.machine.cycle.period.as_s();
        // The velocity loop sees the held command tick by tick: a mean of delayed ticks.
        let every = self.machine.cycle.position_every;
        let held = hold(tick_s * f64::from(every), omega) / hold(tick_s, omega);
        held / Complex::new(0.0, omega)
    }
}

/// All of the loops of an axis that no gain changes, on the frequencies of their margins: what a search over gains
/// computes once.
#[derive(Clone, Debug)]
pub struct Gainless {
    /// Of the velocity loop and of the position loop.
    grids: [Grid; 2],
}

#[derive(Clone, Debug)]
struct Grid {
    omegas: Vec<f64>,
    known: Vec<Known>,
}

/// At one frequency.
#[derive(Clone, Copy, Debug)]
struct Known {
    omega: f64,
    behind_controller: Complex<f64>,
    seen: Complex<f64>,
    /// With the latency of the position.
    behind_velocity: Complex<f64>,
}

impl Gainless {
    /// Of an axis; the gains of the loops do not matter.
    pub fn of(loops: &Loops<'_>) -> Self {
        let (tick_s, every) = (loops.machine.cycle.period.as_s(), loops.machine.cycle.position_every);
        let grid = |sampled_every: u32| {
            let resonance_hz = loops.axis.plant.mechanics.resonance_hz();
            let omegas = margins::grid(1.0 / (tick_s * f64::from(sampled_every)), resonance_hz);
            let known = |&omega: &f64| Known {
                omega,
                behind_controller: loops.behind_controller(omega),
                seen: loops.seen(omega),
                behind_velocity: loops.behind_velocity(omega) * loops.latency(omega),
            };
            Grid { known: omegas.iter().map(known).collect(), omegas }
        };
        Self { grids: [grid(1), grid(every)] }
    }
}

impl Grid {
    fn margins(&self, known: impl Fn(&Known) -> Complex<f64>, open: impl Fn(f64) -> Complex<f64>) -> Margins {
        let responses: Vec<Complex<f64>> = self.known.iter().map(known).collect();
        Margins::on(&self.omegas, &responses, open)
    }
}

/// What holding a value over `span_s` does to it: `(1 - exp(-s T)) / (s T)`.
pub(super) fn hold(span_s: f64, omega: f64) -> Complex<f64> {
    let half_turn = 0.5 * span_s * omega;
    Complex::from_polar(half_turn.sin() / half_turn, -half_turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::config;

    const STANDARD: u8 = 0;
    const OPTIMAL: u8 = 1;

    fn machine(name: &str) -> Machine {
        config::load(name).expect("an embedded machine is sound")
    }

    /// The paper's machine sampled so fast that it is continuous, with a pure delay in its velocity loop.
    fn delayed(delay: Span) -> Machine {
        let mut machine = machine("paper");
        machine.cycle.period = Span::ns(100);
        for (_, axis) in machine.axes.iter_mut() {
            axis.plant.actuator.dead_time = delay;
        }
        machine
    }

    #[test]
    fn the_continuous_loop_has_the_known_crossovers_and_phase_margins() {
        // Two-mass plant, continuous Eq. (5), half a tick and one and a half of 0.5 ms.
        for (set, delay_us, crossover_hz, phase_margin_deg) in [
            (STANDARD, 250, 36.0, 52.6),
            (STANDARD, 750, 36.0, 46.1),
            (OPTIMAL, 250, 44.0, 33.7),
            (OPTIMAL, 750, 44.0, 25.8),
        ] {
            let machine = delayed(Span::us(delay_us));
            let margins = Loops::new(&machine, AxisId::X, set).velocity_margins();
            let crossover = margins.crossover_hz.unwrap_or(f64::NAN);
            assert!((crossover - crossover_hz).abs() < 0.5, "{crossover} Hz, known are {crossover_hz} Hz");
            let margin = margins.phase_margin_deg.unwrap_or(f64::NAN);
            assert!((margin - phase_margin_deg).abs() < 0.05, "{margin} deg, known are {phase_margin_deg}");
        }
    }

    #[test]
    fn each_delay_takes_its_phase_from_the_margin() {
        let margin_of = |machine: &Machine| {
            let margins = Loops::new(machine, AxisId::X, STANDARD).velocity_margins();
            (margins.crossover_hz.unwrap_or(f64::NAN), margins.phase_margin_deg.unwrap_or(f64::NAN))
        };
        let paper = machine("paper");
        let (crossover_hz, margin_deg) = margin_of(&paper);
        let mut late = paper.clone();
        late.axes[AxisId::X].feedback_latency = Span::us(200);
        late.axes[AxisId::X].plant.actuator.dead_time = Span::us(300);
        late.axes[AxisId::X].sheet.command_applies =
            machine("reference").axes[AxisId::X].sheet.command_applies;
        let taken_deg = margin_deg - margin_of(&late).1;
        let known_deg = 360.0 * crossover_hz * 1000e-6;
        assert!((taken_deg - known_deg).abs() < 1e-6, "{taken_deg} deg taken by 1 ms, known {known_deg}");
        let [none_s, all_s] = [&paper, &late].map(|m| Loops::new(m, AxisId::X, STANDARD).dead_time_s());
        assert!((all_s - none_s - 1e-3).abs() < 1e-9, "{none_s} s and {all_s} s of dead time");
    }

    #[test]
    fn what_no_gain_changes_gives_the_same_margins() {
        for name in ["reference", "paper"] {
            let machine = machine(name);
            let known = Gainless::of(&Loops::new(&machine, AxisId::X, STANDARD));
            for set in [STANDARD, OPTIMAL] {
                let loops = Loops::new(&machine, AxisId::X, set);
                let [velocity, position] = loops.margins_on(&known);
                let pairs = [(velocity, loops.velocity_margins()), (position, loops.position_margins())];
                for (on_grid, alone) in pairs {
                    let figures = |m: &Margins| {
                        [m.crossover_hz, m.phase_margin_deg, m.gain_margin_db, Some(m.sensitivity_max)]
                    };
                    for (a, b) in figures(&on_grid).into_iter().zip(figures(&alone)) {
                        let off = a.zip(b).map_or(f64::NAN, |(a, b)| a / b - 1.0);
                        assert!(off.abs() < 1e-9 || a == b, "{name}, set {set}: {on_grid:?}, {alone:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_reference_machine_waits_two_ticks() {
        // Half a tick of hold, one until the command applies, half of the difference.
        let machine = machine("reference");
        let dead_s = Loops::new(&machine, AxisId::X, STANDARD).dead_time_s();
        assert!((dead_s - 1e-3).abs() < 1e-9, "{dead_s} s");
    }

    /// `dR = R/2 (w/Kp)^2 (1 - 2 Kp tau) - 3/8 R (w/Kp)^4`, `tau = (T_p - T_v) / 2`, in um.
    fn radius_decrease_um(kp: f64, radius_m: f64, feed_m_per_s: f64) -> f64 {
        let (x, tau_s) = (feed_m_per_s / radius_m / kp, 0.75e-3);
        1e6 * radius_m * (0.5 * x * x * (1.0 - 2.0 * kp * tau_s) - 0.375 * x.powi(4))
    }

    #[test]
    fn the_radius_decrease_is_that_of_the_closed_form() {
        let (radius, feed) = (Position::mm(150.0), Velocity::mm_per_min(2000.0));
        for (kp, known_um) in [(8.55, 49.989), (20.0, 9.0), (30.0, 3.9), (50.0, 1.4)] {
            let mut machine = machine("paper");
            machine.axes[AxisId::X].control.gain_sets[0].position.gain_per_s = kp;
            let um = Loops::new(&machine, AxisId::X, STANDARD).radius_decrease(radius, feed).as_um();
            let formula_um = radius_decrease_um(kp, radius.as_m(), feed.as_m_per_s());
            assert!((um - formula_um).abs() < 0.002, "Kp {kp} 1/s: {um} um, closed form {formula_um} um");
            assert!((um - known_um).abs() < 0.05, "Kp {kp} 1/s: {um} um, known {known_um} um");
        }
    }

    #[test]
    fn velocity_feed_forward_takes_the_radius_decrease_away() {
        let mut machine = machine("paper");
        machine.axes[AxisId::X].control.gain_sets[0].position.velocity_feed_forward = 1.0;
        let loops = Loops::new(&machine, AxisId::X, STANDARD);
        let um = loops.radius_decrease(Position::mm(150.0), Velocity::mm_per_min(2000.0)).as_um();
        // What the hold of the position loop leaves: far less than the 50 um without.
        assert!(um.abs() < 0.7, "{um} um");
        assert_eq!(loops.following_error(Velocity::mm_per_s(33.3)), Position::ZERO);
    }

    #[test]
    fn the_following_error_is_velocity_over_gain() {
        let machine = machine("reference");
        let loops = Loops::new(&machine, AxisId::X, STANDARD);
        let mm = loops.following_error(Velocity::mm_per_min(2000.0)).as_mm();
        assert!((mm - 33.333_333 / 8.55).abs() < 1e-6, "{mm} mm");
    }
}
