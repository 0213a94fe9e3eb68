//! Limits of a machine file that the measured motion goes beyond: the machine that moved so does not have them.
//!
//! A command that is held back in simulation and was not on the machine leaves more than any effect does.
//! Units: mm, mm/s, A. Invariant: a limit that the motion keeps stays as filed.

use std::collections::BTreeMap;

use super::controller::{WELL, best_gains, explained, left_of};
use crate::base::axis::AxisId;
use crate::base::units::{Current, Position, Velocity};
use crate::config::Machine;
use crate::offline::gap::runs::{AxisRun, Run};
use crate::rt::control::limits::Limits;

/// Loops without a limit must leave this share of what those with it leave of the current: the limit acts on them and did not on
/// the machine.
const LEFT: f64 = 0.9;
/// A limit that does not act is so many times as far as the motion goes.
const OUT_OF_REACH: f64 = 4.0;
/// Time over which velocity and current are measured, s: noise of single rows is no motion.
const OVER_S: f64 = 0.01;

/// The machine without the limits that the runs go beyond and that do not explain their current, and what to say of them; nothing
/// where there are none: behind a command that was held back there is overshoot too.
pub fn lifted(machine: &Machine, runs: &[Run]) -> Option<(Machine, Vec<String>)> {
    let (mut lifted, said) = beyond(machine, runs);
    let ids: Vec<AxisId> = said.keys().copied().collect();
    let [filed, without] = [machine, &lifted].map(|machine| explained(machine, &ids, runs));
    let mut all = Vec::new();
    for ((id, said), (filed, without)) in said.into_iter().zip(filed.iter().zip(&without)) {
        let [filed, without] = [filed, without].map(|matches| left_of(matches, best_gains(matches)));
        // Loops that explain it neither way, as behind commands that are filtered, tell nothing: what was reached was reached.
        if without < LEFT * filed || filed.min(without) > WELL {
            all.extend(said);
        } else {
            lifted.axes[id] = machine.axes[id];
        }
    }
    (!all.is_empty()).then_some((lifted, all))
}

/// The machine without the limits that the runs go beyond, and what to say of each axis that does.
fn beyond(machine: &Machine, runs: &[Run]) -> (Machine, BTreeMap<AxisId, Vec<String>>) {
    let mut lifted = machine.clone();
    let mut all = BTreeMap::new();
    for (id, name) in machine.axes.axes().zip(machine.axis_names()) {
        let axis = &mut lifted.axes[id];
        let mut said = Vec::new();
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
            if reached.velocity > velocity {
                let [limit, reached] = [velocity, reached.velocity].map(Velocity::as_mm_per_s);
                say("limits.velocity-mm-per-s", limit, reached, "mm/s");
                axis.control.limits.velocity = Velocity::mm_per_s(OUT_OF_REACH * reached);
            }
            if reached.current > current {
                let [limit, reached] = [current, reached.current].map(Current::as_a);
                say("limits.current-a", limit, reached, "A");
                let far = Current::a(OUT_OF_REACH * reached);
                axis.control.limits.current = far;
                axis.plant.actuator.peak_current = far;
            }
            let [low, high] = reached.ends.map(Position::as_mm);
            if reached.ends[0] < travel_min {
                say("limits.travel-min-mm", travel_min.as_mm(), low, "mm");
                axis.control.limits.travel_min = Position::mm(low - OUT_OF_REACH * low.abs());
            }
            if reached.ends[1] > travel_max {
                say("limits.travel-max-mm", travel_max.as_mm(), high, "mm");
                axis.control.limits.travel_max = Position::mm(high + OUT_OF_REACH * high.abs());
            }
        }
        if !said.is_empty() {
            all.insert(id, said);
        }
    }
    (lifted, all)
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
    use super::*;
    use crate::config;
    use crate::offline::gap::measure::forward::{Course, without_counts};

    const PERIOD_S: f64 = 5e-4;

    /// Axis x as a machine moves it from rest so far at a velocity, with a smooth start.
    fn run(of: &Machine, mm_per_s: f64, mm: f64) -> Run {
        let rows = (1e3 + mm / mm_per_s / PERIOD_S) as usize + 600;
        let mut velocity_m_per_s = 0.0;
        let mut at_m = 0.0;
        let mut setpoint_m = vec![0.0; rows];
        for (row, setpoint) in setpoint_m.iter_mut().enumerate() {
            let wanted = if row < 1_000 || at_m >= 1e-3 * mm { 0.0 } else { 1e-3 * mm_per_s };
            velocity_m_per_s += 0.01 * (wanted - velocity_m_per_s);
            at_m += velocity_m_per_s * PERIOD_S;
            *setpoint = at_m;
        }
        let still = |position_m: Vec<f64>, current_a: Vec<f64>| {
            let axis = AxisRun { setpoint_m: setpoint_m.clone(), position_m, table_m: None, current_a };
            Run {
                name: "rapid".to_owned(),
                start_s: 0.0,
                period_s: PERIOD_S,
                axes: BTreeMap::from([(AxisId::X, axis)]),
                is_sound: vec![true; rows],
            }
        };
        let course = Course::new(&still(vec![0.0; rows], vec![0.0; rows]), of, AxisId::X, 0, 0.0);
        let x = &of.axes[AxisId::X];
        let made = course.expect("an axis").run(&without_counts(x), of.cycle.position_every, 0, &x.plant);
        let behind = setpoint_m.iter().zip(&made.following_error_m);
        let position_m = behind.map(|(setpoint, behind)| setpoint - behind).collect();
        still(position_m, made.current_a)
    }

    /// The machine with other limits of axis x.
    fn with(machine: &Machine, change: impl Fn(&mut Limits)) -> Machine {
        let mut other = machine.clone();
        change(&mut other.axes[AxisId::X].control.limits);
        other
    }

    #[test]
    fn a_limit_that_the_motion_goes_beyond_is_none_of_that_machine() {
        let filed = config::load("paper").expect("a machine");
        let faster = with(&filed, |limits| limits.velocity = Velocity::mm_per_s(400.0));
        // Hardly faster than the limit too: what holds a command back a little hides what is missing as well.
        for mm_per_s in [260.0, 300.0] {
            let (without, said) = lifted(&filed, &[run(&faster, mm_per_s, 200.0)]).expect("it is too fast");
            assert_eq!(said.len(), 1, "{said:?}");
            assert!(
                said[0].contains("axis x: reaches") && said[0].contains("limits.velocity-mm-per-s = 250.0"),
                "{said:?}"
            );
            let [x, y] = [AxisId::X, AxisId::Y].map(|id| without.axes[id].control.limits);
            assert!(x.velocity > Velocity::mm_per_s(1_000.0));
            assert_eq!(y, filed.axes[AxisId::Y].control.limits);
            assert_eq!((x.current, x.travel_max), (y.current, y.travel_max));
        }
    }

    #[test]
    fn a_limit_that_holds_the_machine_back_is_its_own() {
        let filed = config::load("paper").expect("a machine");
        let held_back = run(&filed, 300.0, 200.0);
        assert_eq!(beyond(&filed, std::slice::from_ref(&held_back)).1.len(), 1, "it overshoots");
        assert!(lifted(&filed, &[held_back]).is_none());
        assert!(lifted(&filed, &[run(&filed, 200.0, 200.0)]).is_none());
    }

    #[test]
    fn a_limit_that_an_axis_goes_beyond_is_none_whatever_its_loops_leave() {
        let filed = config::load("paper").expect("a machine");
        let other = with(&filed, |limits| limits.velocity = Velocity::mm_per_s(400.0));
        // Behind a filter of commands, most runs tell nothing of limits and leave more than that in which they do.
        let filtered = |mm_per_s: f64, mm: f64| {
            let mut run = run(&other, mm_per_s, mm);
            let axis = run.axes.get_mut(&AxisId::X).expect("an axis");
            let ahead_m = |row: usize| axis.setpoint_m[(row + 10).min(axis.setpoint_m.len() - 1)];
            axis.setpoint_m = (0..axis.setpoint_m.len()).map(ahead_m).collect();
            run
        };
        let mut runs = vec![filtered(240.0, 240.0); 20];
        runs.push(filtered(270.0, 120.0));
        let (without, _) = lifted(&filed, &runs).expect("it is too fast");
        assert!(without.axes[AxisId::X].control.limits.velocity > Velocity::mm_per_s(1_000.0));
    }

    #[test]
    fn so_are_current_and_travel() {
        let filed = config::load("paper").expect("a machine");
        let stronger = with(&filed, |limits| {
            limits.travel_max = Position::mm(400.0);
            limits.travel_min = Position::mm(-400.0);
        });
        let (without, said) = lifted(&filed, &[run(&stronger, 150.0, 262.0)]).expect("it goes further");
        assert!(said[0].contains("limits.travel-max-mm = 250.0"), "{said:?}");
        let [x, own] = [&without, &filed].map(|machine| machine.axes[AxisId::X].control.limits);
        assert!(x.travel_max > Position::mm(500.0));
        assert_eq!((x.travel_min, x.current), (own.travel_min, own.current));
        let weak = with(&filed, |limits| limits.current = Current::a(2.0));
        let (without, said) = lifted(&weak, &[run(&filed, 200.0, 100.0)]).expect("it is stronger");
        assert!(said[0].contains("limits.current-a = 2.0"), "{said:?}");
        let x = &without.axes[AxisId::X];
        assert!(x.control.limits.current > Current::a(4.0));
        assert_eq!(x.plant.actuator.peak_current, x.control.limits.current);
    }
}
