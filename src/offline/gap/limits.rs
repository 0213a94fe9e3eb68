//! Limits of a machine file that the measured motion goes beyond: the machine that moved so does not have them.
//!
//! A command that is held back in simulation and was not on the machine leaves more than any effect does.
//! Units: mm, mm/s, A. Invariant: a limit that the motion keeps stays as filed.

use super::runs::{AxisRun, Run};
use crate::base::units::{Current, Position, Velocity};
use crate::config::Machine;
use crate::rt::control::limits::Limits;

/// Beyond a limit by this share of it is no overshoot behind a command that was held back.
const BEYOND: f64 = 0.1;
/// Nor is so much beyond an end of the travel, m.
const BEYOND_M: f64 = 2e-4;
/// A limit that does not act is so many times as far as the motion goes.
const OUT_OF_REACH: f64 = 4.0;
/// Time over which velocity and current are measured, s: noise of single rows is no motion.
const OVER_S: f64 = 0.01;

/// The machine without the limits that the runs go beyond, and what to say of them; nothing where there are none.
pub fn lifted(machine: &Machine, runs: &[Run]) -> Option<(Machine, Vec<String>)> {
    let mut lifted = machine.clone();
    let mut said = Vec::new();
    for (id, name) in machine.axes.axes().zip(machine.axis_names()) {
        let axis = &mut lifted.axes[id];
        for (run, columns) in runs.iter().filter_map(|run| Some((run, run.axes.get(&id)?))) {
            let reached = Reached::of(columns, run.period_s);
            let Limits { velocity, current, travel_min, travel_max, .. } = axis.control.limits;
            let mut say = |key: &str, limit: f64, reached: f64, unit: &str| {
                said.push(format!(
                    "{}, axis {name}: reaches {reached:.1} {unit}, beyond {key} = {limit:.1}: the machine that was measured has no \
                     such limit, and none is simulated",
                    run.name
                ));
            };
            if reached.velocity > velocity * (1.0 + BEYOND) {
                let [limit, reached] = [velocity, reached.velocity].map(Velocity::as_mm_per_s);
                say("limits.velocity-mm-per-s", limit, reached, "mm/s");
                axis.control.limits.velocity = Velocity::mm_per_s(OUT_OF_REACH * reached);
            }
            if reached.current > current * (1.0 + BEYOND) {
                let [limit, reached] = [current, reached.current].map(Current::as_a);
                say("limits.current-a", limit, reached, "A");
                let far = Current::a(OUT_OF_REACH * reached);
                axis.control.limits.current = far;
                axis.plant.actuator.peak_current = far;
            }
            let [low, high] = reached.ends.map(Position::as_mm);
            if reached.ends[0] < travel_min - Position::m(BEYOND_M) {
                say("limits.travel-min-mm", travel_min.as_mm(), low, "mm");
                axis.control.limits.travel_min = Position::mm(low - OUT_OF_REACH * low.abs());
            }
            if reached.ends[1] > travel_max + Position::m(BEYOND_M) {
                say("limits.travel-max-mm", travel_max.as_mm(), high, "mm");
                axis.control.limits.travel_max = Position::mm(high + OUT_OF_REACH * high.abs());
            }
        }
    }
    (!said.is_empty()).then_some((lifted, said))
}

/// How far an axis goes in a run.
struct Reached {
    velocity: Velocity,
    current: Current,
    /// Of its motor.
    ends: [Position; 2],
}

impl Reached {
    fn of(axis: &AxisRun, period_s: f64) -> Self {
        let rows = ((OVER_S / period_s) as usize).max(1);
        let over_s = rows as f64 * period_s;
        let ways_m = axis.position_m.iter().zip(axis.position_m.iter().skip(rows));
        let fastest = ways_m.map(|(from, to)| (to - from).abs() / over_s).fold(0.0, f64::max);
        let means_a =
            axis.current_a.chunks_exact(rows).map(|rows| rows.iter().sum::<f64>() / rows.len() as f64);
        let most_a = means_a.map(f64::abs).fold(0.0, f64::max);
        let low_m = axis.position_m.iter().copied().fold(f64::INFINITY, f64::min);
        let high_m = axis.position_m.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self {
            velocity: Velocity::m_per_s(fastest),
            current: Current::a(most_a),
            ends: [low_m, high_m].map(Position::m),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;

    const PERIOD_S: f64 = 5e-4;

    /// Axis x moves on at a velocity, under a current.
    fn run(mm_per_s: f64, current_a: f64) -> Run {
        let rows = 400;
        let position_m: Vec<f64> = (0..rows).map(|row| 1e-3 * mm_per_s * f64::from(row) * PERIOD_S).collect();
        let axis = AxisRun {
            setpoint_m: position_m.clone(),
            position_m,
            table_m: None,
            current_a: vec![current_a; rows as usize],
        };
        Run {
            name: "rapid".to_owned(),
            start_s: 0.0,
            period_s: PERIOD_S,
            axes: BTreeMap::from([(AxisId::X, axis)]),
            is_sound: vec![true; rows as usize],
        }
    }

    #[test]
    fn a_limit_that_the_motion_goes_beyond_is_none_of_that_machine() {
        let machine = config::load("paper").expect("a machine");
        assert!(
            lifted(&machine, &[run(260.0, 10.0), run(-240.0, -20.5)]).is_none(),
            "overshoot behind a limit"
        );
        let (faster, said) = lifted(&machine, &[run(300.0, 10.0)]).expect("it is too fast");
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(
            said[0].contains("axis x: reaches 300.0 mm/s, beyond limits.velocity-mm-per-s = 250.0"),
            "{said:?}"
        );
        let [x, y] = [AxisId::X, AxisId::Y].map(|id| faster.axes[id].control.limits);
        assert!(x.velocity > Velocity::mm_per_s(1_000.0));
        assert_eq!(y, machine.axes[AxisId::Y].control.limits);
        assert_eq!((x.current, x.travel_max), (y.current, y.travel_max));
    }

    #[test]
    fn so_are_current_and_travel() {
        let machine = config::load("paper").expect("a machine");
        let mut far = run(10.0, -26.0);
        far.axes.get_mut(&AxisId::X).expect("x").position_m.fill(-0.251);
        let (other, said) = lifted(&machine, &[far]).expect("it goes further");
        assert_eq!(said.len(), 2, "{said:?}");
        let x = &other.axes[AxisId::X];
        assert!(
            x.control.limits.current > Current::a(50.0) && x.plant.actuator.peak_current > Current::a(50.0)
        );
        assert!(x.control.limits.travel_min < Position::mm(-500.0));
        assert_eq!(x.control.limits.travel_max, machine.axes[AxisId::X].control.limits.travel_max);
    }
}
