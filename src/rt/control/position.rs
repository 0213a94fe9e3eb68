//! Position loop of one axis: `v_command = K_p (x_setpoint - x) + k_ff v_setpoint`, at every so many
//! ticks and held in between.
//!
//! Beside it runs the response that this loop has when the velocity loop is perfect, the *expected*
//! response: `x̂` integrates its own command. The following-error limit watches the distance to `x̂`
//! (a lag of 3.9 mm at 33 mm/s is right at K_p = 8.55 1/s, a distance of 1 mm from it is not), and the
//! feed-forwards look at its velocity, which reverses when the axis does, not when the setpoint does.
//! Invariant: a swap of gains changes the velocity command by less than the swap's bump times its decay.

use crate::base::setpoint::Setpoint;
use crate::base::units::{Acceleration, Position, Velocity};

/// Gains of the position loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// `K_p`, 1/s.
    pub gain_per_s: f64,
    /// Share of the setpoint's velocity that is fed forward, 0 to 1.
    pub velocity_feed_forward: f64,
}

/// State of the loop: what it asked for last, and its expected response.
#[derive(Clone, Copy, Debug, Default)]
pub struct PositionLoop {
    command: Velocity,
    /// What swaps of gains left over, in the command and in the expected response, fading with `K_p`.
    bump: Velocity,
    expected_bump: Velocity,
    expected_position: Position,
    expected_velocity: Velocity,
    expected_acceleration: Acceleration,
    /// What is added to the command behind this loop.
    excitation: Velocity,
}

impl PositionLoop {
    /// Standing where the axis stands.
    pub fn reset(&mut self, position: Position) {
        *self = Self { expected_position: position, ..Self::default() };
    }

    /// A tick of the position loop, `since_s` after the one before.
    pub fn update(&mut self, gains: &Gains, setpoint: &Setpoint, position: Position, since_s: f64) {
        let wanted = |from: Position| {
            let ahead_m = (setpoint.position - from).as_m();
            Velocity::m_per_s(
                gains.gain_per_s * ahead_m + gains.velocity_feed_forward * setpoint.velocity.as_m_per_s(),
            )
        };
        let fade = (1.0 - gains.gain_per_s * since_s).max(0.0);
        self.bump = self.bump * fade;
        self.expected_bump = self.expected_bump * fade;
        self.command = wanted(position) + self.bump;
        let expected = wanted(self.expected_position) + self.expected_bump;
        let change = expected - self.expected_velocity;
        self.expected_acceleration = Acceleration::m_per_s2(change.as_m_per_s() / since_s);
        self.expected_velocity = expected;
    }

    /// What is added to the command behind this loop from now on. The expected response follows it, so that
    /// the distance to it is no following error.
    pub fn excite(&mut self, excitation: Velocity) {
        self.excitation = excitation;
    }

    /// The expected response moves on, for as long as its velocity is held.
    pub fn coast(&mut self, time_s: f64) {
        let velocity = self.expected_velocity + self.excitation;
        self.expected_position += Position::m(velocity.as_m_per_s() * time_s);
    }

    /// Other gains from now on; what they would change at once fades away instead.
    pub fn swap(&mut self, from: &Gains, to: &Gains, setpoint: &Setpoint, position: Position) {
        let feed_forward = from.velocity_feed_forward - to.velocity_feed_forward;
        let missing = |place: Position| {
            let ahead_m = (setpoint.position - place).as_m();
            Velocity::m_per_s(
                (from.gain_per_s - to.gain_per_s) * ahead_m + feed_forward * setpoint.velocity.as_m_per_s(),
            )
        };
        // Each response keeps its own velocity, so a following error is neither made nor forgiven.
        self.bump += missing(position);
        self.expected_bump += missing(self.expected_position);
    }

    /// The velocity asked for.
    pub fn command(&self) -> Velocity {
        self.command
    }
    /// Where the axis would be behind a perfect velocity loop.
    pub fn expected_position(&self) -> Position {
        self.expected_position
    }
    /// How fast it would be there, but for the excitation.
    pub fn expected_velocity(&self) -> Velocity {
        self.expected_velocity
    }
    /// What is added to the command behind this loop.
    pub fn excitation(&self) -> Velocity {
        self.excitation
    }
    /// How its speed would change.
    pub fn expected_acceleration(&self) -> Acceleration {
        self.expected_acceleration
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAINS: Gains = Gains { gain_per_s: 8.55, velocity_feed_forward: 0.0 };

    fn running(position_m: f64) -> Setpoint {
        Setpoint {
            position: Position::m(position_m),
            velocity: Velocity::m_per_s(0.03),
            ..Setpoint::default()
        }
    }

    #[test]
    fn the_expected_response_lags_by_velocity_over_gain() {
        let mut loop_ = PositionLoop::default();
        let mut place_m = 0.0;
        for _ in 0..4000 {
            loop_.update(&GAINS, &running(place_m), loop_.expected_position(), 2e-3);
            for _ in 0..4 {
                loop_.coast(5e-4);
            }
            place_m += 0.03 * 2e-3;
        }
        let lag_m = place_m - loop_.expected_position().as_m();
        // Sampled: the lag seen at a tick is v / K_p.
        assert!((lag_m - 0.03 / 8.55).abs() < 1e-9, "lag {lag_m} m");
        assert!((loop_.expected_velocity().as_m_per_s() - 0.03).abs() < 1e-9);
    }

    #[test]
    fn a_swap_at_speed_changes_no_command_and_its_trace_fades() {
        let mut loop_ = PositionLoop::default();
        loop_.update(&GAINS, &running(0.0039), Position::ZERO, 2e-3);
        let before = loop_.command();
        let stiff = Gains { gain_per_s: 30.0, velocity_feed_forward: 0.5 };
        loop_.swap(&GAINS, &stiff, &running(0.0039), Position::ZERO);
        loop_.update(&stiff, &running(0.0039), Position::ZERO, 2e-3);
        let step = (loop_.command() - before).as_mm_per_s();
        let whole = 3.9 * (30.0 - 8.55) + 0.5 * 30.0;
        assert!(step.abs() < 0.07 * whole, "a step of {step} mm/s of {whole} mm/s");
        for _ in 0..500 {
            loop_.update(&stiff, &running(0.0039), Position::ZERO, 2e-3);
        }
        let rest = (loop_.command() - Velocity::mm_per_s(3.9 * 30.0 + 0.5 * 30.0)).as_mm_per_s();
        assert!(rest.abs() < 1e-6, "{rest} mm/s left of the bump");
    }

    #[test]
    fn a_swap_forgives_no_following_error() {
        let mut loop_ = PositionLoop::default();
        loop_.update(&GAINS, &running(0.0039), Position::um(-800.0), 2e-3);
        let (place, speed) = (loop_.expected_position(), loop_.expected_velocity());
        let stiff = Gains { gain_per_s: 30.0, velocity_feed_forward: 0.5 };
        loop_.swap(&GAINS, &stiff, &running(0.0039), Position::um(-800.0));
        assert_eq!(loop_.expected_position(), place);
        loop_.update(&stiff, &running(0.0039), Position::um(-800.0), 2e-3);
        let step = (loop_.expected_velocity() - speed).as_mm_per_s();
        let bump = 3.9 * (30.0 - 8.55) + 0.5 * 30.0;
        assert!(step.abs() < 0.07 * bump, "the expected velocity stepped by {step} mm/s of {bump} mm/s");
    }
}
