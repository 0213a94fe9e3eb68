//! Rules of thumb over a sound machine file: each value is allowed, together they are worth a look.
//!
//! Bounds: phase margin and sensitivity as in Åström and Murray, *Feedback Systems*, on stability
//! margins (30 deg and 2 are the weak end of what is reasonable); the others follow from the machine's own limits.
//! Invariant: a warning names the key to change, the value, the bound and the unit.

use super::{AxisReport, GainSetReport, RADIUS, Warning};
use crate::base::axis::AxisId;
use crate::base::units::Torque;
use crate::config::Machine;

const PHASE_MARGIN_DEG_MIN: f64 = 30.0;
const SENSITIVITY_MAX: f64 = 2.0;
/// A resonance this many times above the crossover, or less, is inside the loop's reach.
const RESONANCE_PER_CROSSOVER_MIN: f64 = 2.0;
/// A watchdog must bear one lost command.
const WATCHDOG_PERIODS_MIN: f64 = 2.0;

/// All that is worth a look.
pub(super) fn of(machine: &Machine, axes: &[AxisReport]) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for (id, report) in machine.axes.axes().zip(axes) {
        let mut warn = |key: &str, message: String| {
            warnings.push(Warning { key: format!("axis.{}.{key}", report.axis), message });
        };
        board(machine, id, &mut warn);
        for set in &report.gain_sets {
            let key = format!("gains.{}", set.gains);
            loops(report, set, &mut |message| warn(&key, message));
        }
        limits(machine, id, report, &mut warn);
        for (entry, _) in machine.axes[id].plant.effects.present().filter(|(entry, _)| entry.is_of_control())
        {
            warn(
                &format!("effects.{}", entry.name),
                "is of a control that recorded data: on a bus the control is the cycle, which has none of it"
                    .to_owned(),
            );
        }
    }
    warnings
}

fn board(machine: &Machine, id: AxisId, warn: &mut impl FnMut(&str, String)) {
    let axis = &machine.axes[id];
    let (watchdog, limits) = (axis.sheet.watchdog(), &axis.control.limits);
    let periods = watchdog.as_s() / machine.cycle.period.as_s();
    if periods < WATCHDOG_PERIODS_MIN {
        let (is_us, least_us) = (watchdog.as_us(), WATCHDOG_PERIODS_MIN * machine.cycle.period.as_us());
        warn(
            "board.sheet",
            format!(
                "one lost command trips the board's watchdog of {is_us} us; two periods are {least_us} us"
            ),
        );
    }
    let run_mm = limits.velocity.as_mm_per_s() * watchdog.as_s();
    if run_mm > limits.travel_margin.as_mm() {
        let margin_mm = limits.travel_margin.as_mm();
        warn(
            "board.sheet",
            format!(
                "without commands the axis runs up to {run_mm:.2} mm before the board's watchdog of {} us acts; \
                 the travel margin is {margin_mm:.2} mm",
                watchdog.as_us()
            ),
        );
    }
}

fn loops(axis: &AxisReport, set: &GainSetReport, warn: &mut impl FnMut(String)) {
    for (name, margins) in [("velocity", &set.velocity_loop), ("position", &set.position_loop)] {
        let phase_deg = margins.phase_margin_deg;
        if !margins.is_stable() {
            let shown =
                |value: Option<f64>| value.map_or("without".to_owned(), |value| format!("{value:.1}"));
            warn(format!(
                "the {name} loop is unstable: {} deg of phase margin, {} dB of gain margin",
                shown(phase_deg),
                shown(margins.gain_margin_db)
            ));
            continue;
        }
        if let Some(deg) = phase_deg.filter(|deg| *deg < PHASE_MARGIN_DEG_MIN) {
            warn(format!(
                "phase margin of the {name} loop is {deg:.1} deg; less than {PHASE_MARGIN_DEG_MIN} deg rings"
            ));
        }
        let peak = margins.sensitivity_max;
        if peak > SENSITIVITY_MAX {
            warn(format!(
                "the {name} loop makes disturbances up to {peak:.2} times larger (Ms); usual is up to \
                 {SENSITIVITY_MAX}"
            ));
        }
    }
    let crossover_hz = set.velocity_loop.crossover_hz.unwrap_or(0.0);
    if axis.resonance_hz < RESONANCE_PER_CROSSOVER_MIN * crossover_hz {
        warn(format!(
            "motor and table swing at {:.1} Hz, less than {RESONANCE_PER_CROSSOVER_MIN} times the velocity \
             loop's crossover of {crossover_hz:.1} Hz",
            axis.resonance_hz
        ));
    }
}

fn limits(machine: &Machine, id: AxisId, report: &AxisReport, warn: &mut impl FnMut(&str, String)) {
    let axis = &machine.axes[id];
    let (limits, plant) = (&axis.control.limits, &axis.plant);
    let room = (-limits.travel_min).as_mm().min(limits.travel_max.as_mm());
    if room < RADIUS.as_mm() {
        warn(
            "limits.travel-max-mm",
            format!(
                "a circle around zero may have up to {room:.1} mm of radius; the usual test has {} mm",
                RADIUS.as_mm()
            ),
        );
    }
    let accelerating = plant.mechanics.torque_for_acceleration(machine.motion.path_acceleration);
    let needed: Torque = accelerating + plant.mechanics.torque_for_force(plant.friction.breakaway);
    let (needed_a, limit_a) = (plant.actuator.current(needed).as_a(), limits.current.as_a());
    if needed_a > limit_a {
        warn(
            "limits.current-a",
            format!(
                "break-away and the path acceleration together need {needed_a:.2} A; the limit is {limit_a:.2} A"
            ),
        );
    }
    let standstill = limits.standstill.as_mm_per_s();
    if standstill < report.velocity_step_mm_per_s {
        warn(
            "limits.standstill-mm-per-s",
            format!(
                "one count of the encoder looks like {:.4} mm/s, faster than {standstill:.4} mm/s of standstill",
                report.velocity_step_mm_per_s
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::MachineReport;
    use super::*;
    use crate::base::units::{Current, Position, Velocity};
    use crate::config;

    /// Warnings of the paper's machine, of which none is about axis y, after a change to axis x.
    fn warned(change: impl Fn(&mut config::machine::Axis)) -> Vec<(String, String)> {
        let mut machine = config::load("paper").expect("an embedded machine is sound");
        change(&mut machine.axes[AxisId::X]);
        let warnings = MachineReport::of(&machine).warnings;
        warnings.into_iter().map(|warning| (warning.key, warning.message)).collect()
    }

    fn assert_warns(change: impl Fn(&mut config::machine::Axis), key: &str, words: &str) {
        let warnings = warned(change);
        let is_there = warnings.iter().any(|(at, message)| at == key && message.contains(words));
        assert!(is_there, "no \"{words}\" at {key} in {warnings:#?}");
    }

    #[test]
    fn the_machine_of_the_paper_is_worth_no_warning() {
        assert_eq!(warned(|_| {}), []);
    }

    #[test]
    fn each_rule_speaks_of_its_key() {
        let board = "axis.x.board.sheet";
        assert_warns(|axis| axis.sheet.watchdog_us = 999, board, "two periods are 1000 us");
        assert_warns(|axis| axis.sheet.watchdog_us = 20_100, board, "runs up to 5.03 mm");
        let gains = "axis.x.gains.standard";
        let late = |axis: &mut config::machine::Axis, us| {
            axis.plant.actuator.dead_time = crate::base::time::Span::us(us);
        };
        assert_warns(|axis| late(axis, 2_000), gains, "less than 30 deg rings");
        assert_warns(|axis| late(axis, 2_000), gains, "times larger (Ms)");
        assert_warns(|axis| late(axis, 6_000), gains, "the velocity loop is unstable");
        let stiff = |axis: &mut config::machine::Axis| {
            axis.control.gain_sets[0].position.gain_per_s = 400.0;
        };
        assert_warns(stiff, gains, "the position loop is unstable");
        let soft = |axis: &mut config::machine::Axis| axis.plant.mechanics.stiffness_n_per_m = 40e6;
        assert_warns(soft, gains, "motor and table swing at");
        let limits = |axis: &mut config::machine::Axis, key: &str| match key {
            "travel-max-mm" => axis.control.limits.travel_max = Position::mm(149.0),
            "current-a" => axis.control.limits.current = Current::a(4.0),
            _ => axis.control.limits.standstill = Velocity::mm_per_s(1e-5),
        };
        let filter = crate::plant::effects::entry("command-filter").expect("an effect of the catalogue");
        let filtered =
            |axis: &mut config::machine::Axis| axis.plant = axis.plant.with_effect(filter, filter.nominal());
        assert_warns(filtered, "axis.x.effects.command-filter", "has none of it");
        for (key, words) in [
            ("travel-max-mm", "up to 149.0 mm of radius"),
            ("current-a", "together need 4.30 A"),
            ("standstill-mm-per-s", "one count of the encoder"),
        ] {
            assert_warns(|axis| limits(axis, key), &format!("axis.x.limits.{key}"), words);
        }
    }
}
