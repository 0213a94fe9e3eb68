//! What the counts of an encoder make of the current: the velocity loop answers to each of them.
//!
//! Passes that come over the same counts hide it, as they hide what the encoder does not resolve. So a simulation with counts
//! tells it, beside one without.
//! Invariant: nothing measured takes part.

use super::forward::{Course, without_counts};
use super::process::{BLOCK_S, autocovariances};
use crate::base::axis::AxisId;
use crate::config::Machine;

/// So much of a run tells it, s.
const LASTS_S: f64 = 10.0;

/// Its autocovariances, A², on a course of an axis; nothing where that is short.
pub(in crate::offline::gap) fn in_current(
    machine: &Machine,
    id: AxisId,
    gain_set: u8,
    course: &Course,
) -> Option<Vec<f64>> {
    let rows_in = |time_s: f64| (time_s / machine.cycle.period.as_s()) as usize;
    let (course, axis) = (course.first(rows_in(LASTS_S)), machine.axes[id]);
    let [counted, smooth] = [axis, without_counts(&axis)]
        .map(|axis| course.run(&axis, machine.cycle.position_every, gain_set, &axis.plant).current_a);
    let differences: Vec<f64> =
        counted.iter().zip(smooth).map(|(counted, smooth)| counted - smooth).collect();
    let about_zero = |block: &[f64]| {
        let mean = block.iter().sum::<f64>() / block.len() as f64;
        block.iter().map(|value| value - mean).collect()
    };
    let blocks: Vec<Vec<f64>> = differences.chunks_exact(rows_in(BLOCK_S).max(1)).map(about_zero).collect();
    autocovariances(&blocks)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::f64::consts::TAU;

    use super::*;
    use crate::config;
    use crate::offline::gap::runs::{AxisRun, Run};

    #[test]
    fn a_count_is_differentiated_by_the_velocity_loop() {
        let machine = config::load("paper").expect("a machine");
        let (id, period_s) = (AxisId::X, machine.cycle.period.as_s());
        // Slow enough that the loops hardly answer to anything but counts.
        let rows = 20_000_u32;
        let setpoint_m: Vec<f64> =
            (0..rows).map(|row| 0.02 * (1.0 - (TAU * 0.1 * f64::from(row) * period_s).cos())).collect();
        let axis = AxisRun {
            position_m: setpoint_m.clone(),
            setpoint_m,
            table_m: None,
            current_a: vec![0.0; rows as usize],
        };
        let run = Run {
            name: "run".to_owned(),
            start_s: 0.0,
            period_s,
            axes: BTreeMap::from([(id, axis)]),
            is_sound: vec![true; rows as usize],
        };
        let course = Course::new(&run, &machine, id, 0, 0.0).expect("it has the axis");
        let axis = &machine.axes[id];
        let actuator = &axis.plant.actuator;
        let count_rad = axis.scale.motor_resolution().as_m() / axis.plant.mechanics.travel_per_rad_m();
        // What one count does in the rows that follow: as a velocity of the second order, behind the lag of the current loop.
        let keeps = (-period_s / actuator.lag_s()).exp();
        let mut last = 0.0;
        let answer: Vec<f64> = [1.5, -2.0, 0.5]
            .into_iter()
            .chain([0.0; 30])
            .map(|seen| {
                last = keeps * last + (1.0 - keeps) * seen;
                last
            })
            .collect();
        let per_count_a = machine.gains(id, 0).velocity.proportional_nm_s_per_rad * count_rad
            / (actuator.torque_constant_nm_per_a * period_s);
        let lags = in_current(&machine, id, 0, &course).expect("it is long enough");
        for (lag, found) in lags[..3].iter().enumerate() {
            let product: f64 = answer.iter().zip(&answer[lag..]).map(|(a, b)| a * b).sum();
            let wanted_a2 = product * per_count_a.powi(2) / 12.0;
            assert!(
                (found - wanted_a2).abs() < 0.1 * lags[0],
                "{found} A² and not {wanted_a2} A² after {lag} rows"
            );
        }
    }
}
