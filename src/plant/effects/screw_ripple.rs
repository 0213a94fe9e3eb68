//! Screw ripple: friction of nut and bearings that comes back with each turn of the screw, or with each half of it.
//!
//! ```text
//!   F(v, θ) = F(v) (1 + a sin(n θ + φ))
//! ```
//!
//! `θ` is the angle of the motor, which a table under load lags behind: by 2° of a ball-pass ripple, one way and the other. The factor acts on the whole law of Eq. (1), on the break-away force as on
//! the sliding one, and is the same at all speeds and both ways. 1 to 5 % are usual; once a turn where screw or bearings
//! run out, twice where the screw is bent or the nut oval. More often it is `ball_pass_ripple`. A further harmonic has
//! values of its own. Real screws also have a share that grows with preload.
//! Invariant: the factor is never negative, so friction only ever takes energy.

use super::super::params::Parameters;
use super::catalogue::{Coordinate, Entry, Experiment, Values};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "screw-ripple",
    summary: "friction that comes back with each turn of the screw",
    equation: "F(v) (1 + a sin(n θ + φ))",
    parameters: &[
        Parameter::new("share-percent", "%", [0.0, 50.0], 5.0, 4.0),
        Parameter::new("periods-per-turn", "", [0.5, 2.1], 1.0, 1.0).whole().per_turn(),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(ripple),
};

pub(super) const HARMONIC: Entry = Entry {
    name: "screw-ripple-harmonic",
    summary: "another friction that comes back with each turn of the screw, or with half of it",
    law_of: Some("screw-ripple"),
    ..ENTRY
};

/// A ripple of this share, so many periods in a turn and this phase.
pub(super) fn ripple(values: &Values, axis: &Parameters) -> Box<dyn Friction> {
    let period_m = axis.mechanics.lead_m / values[1];
    Box::new(Ripple(Swing::new(1e-2 * values[0], period_m, values[2])))
}

/// Friction that swings with the angle of the screw.
#[derive(Debug)]
struct Ripple(Swing);

impl Friction for Ripple {
    fn factor(&self, at: &Instant) -> f64 {
        1.0 + self.0.at(at.motor_m)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::super::tests::paper_axis;
    use super::*;
    use crate::base::time::Span;
    use crate::base::units::{Current, Position};
    use crate::plant::Plant;

    const TICK: Span = Span::us(500);

    fn rippled(share: f64, phase_rad: f64) -> Parameters {
        paper_axis().with_effect(&ENTRY, [1e2 * share, 1.0, phase_rad.to_degrees()])
    }

    /// A rippled axis held at a speed by a stiff loop: where it is, and the current it takes, at each tick.
    fn held(axis: &Parameters, mm_per_s: f64, ticks: usize) -> Vec<(Position, Current)> {
        let mut plant = Plant::new(axis, TICK);
        let mut integral_a = 0.0;
        let hold = |_| {
            let state = plant.state();
            let error = mm_per_s - state.motor_velocity.as_mm_per_s();
            integral_a += 0.05 * error;
            plant.step(Current::a(0.9 * error + integral_a));
            (state.table_position, state.current)
        };
        (0..ticks).map(hold).collect()
    }

    #[test]
    fn the_current_of_a_steady_motion_ripples_once_a_turn_by_the_share() {
        // Two turns of 10 mm at 20 mm/s, after a turn to settle.
        let rows = held(&rippled(0.05, 0.7), 20.0, 3_000);
        let turns = &rows[1_000..];
        let mean_a = turns.iter().map(|(_, current)| current.as_a()).sum::<f64>() / 2_000.0;
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (place, current) in turns {
            let angle = TAU * place.as_mm() / 10.0;
            sine += current.as_a() * angle.sin() / 1_000.0;
            cosine += current.as_a() * angle.cos() / 1_000.0;
        }
        let (share, phase) = (f64::hypot(sine, cosine) / mean_a, cosine.atan2(sine));
        // At 2 Hz the stiff loop and the inertia change the answer by less than 1 %.
        assert!((share - 0.05).abs() < 5e-4, "{share}");
        assert!((phase - 0.7).abs() < 0.05, "{phase} rad");
    }

    #[test]
    fn it_goes_with_the_angle_of_the_screw_and_not_with_the_table_behind_it() {
        let ripple = ripple(&[5.0, 7.6, 30.0], &paper_axis());
        let at = |motor_m: f64, table_m: f64| {
            ripple.factor(&Instant {
                motor_m,
                table_m,
                table_m_per_s: 0.0,
                deflection_m: motor_m - table_m,
                drive_n: 0.0,
                screw_n: 0.0,
                speed_m_per_s: 0.0,
                side: 1.0,
                time_s: 0.0,
            })
        };
        assert_eq!(at(3e-3, 3e-3), at(3e-3, 2.99e-3));
        let wanted = 1.0 + 0.05 * (7.6 * TAU * 3e-3 / 10e-3 + TAU / 12.0).sin();
        // As far as the sine is right.
        assert!((at(3e-3, 2.99e-3) - wanted).abs() < 1e-8);
    }

    #[test]
    fn break_away_ripples_too() {
        // At the start the sine is 1 or -1; the breakaway torque of the paper's axis is 1.994 N m.
        let needs = |phase_rad: f64| {
            let mut plant = Plant::new(&rippled(0.1, phase_rad), TICK);
            let mut current = 0.0;
            while plant.state().is_stuck {
                plant.step(Current::a(current));
                current += 5e-4;
            }
            current
        };
        let (hard, easy) = (needs(0.25 * TAU), needs(0.75 * TAU));
        assert!((hard / easy - 1.1 / 0.9).abs() < 0.01, "{hard} A and {easy} A");
    }

    #[test]
    fn without_ripple_no_bit_changes() {
        let other = rippled(0.0, 2.0);
        assert_eq!(held(&other, 3.0, 2_000), held(&paper_axis(), 3.0, 2_000));
    }

    #[test]
    fn finer_steps_give_the_same() {
        let run = |tick_us: i64, fine: u32| {
            let mut plant = Plant::with_fine_steps(&rippled(0.05, 0.0), Span::us(tick_us), fine);
            for tick in 0..(400_000 / tick_us) {
                let time_s = (tick * tick_us) as f64 * 1e-6;
                // Held over 500 us whatever the tick.
                let held_s = (time_s / 500e-6 + 1e-6).floor() * 500e-6;
                plant.step(Current::a(2.4 * (1.0 + (6.0 * held_s).sin())));
            }
            plant.state().motor_position.as_um()
        };
        let (coarse, fine) = (run(500, 10), run(25, 10));
        assert!((coarse - fine).abs() < 1e-3 * fine.abs().max(10.0), "{coarse} um, in fine steps {fine} um");
    }
}
