//! What a machine file implies: everything `quadrant check` says of a machine before it moves.
//!
//! Time of a cycle and load of its bus, and per axis and gain set the figures of the loops at their
//! real delays, wind-up, and what a circle would show without friction. `rows.rs` names the numbers
//! for a table, `warnings.rs` says which of them an engineer should look at twice.
//! Keys carry their units, as in the machine file. Invariant: pure; the same machine gives the same report.

mod rows;
mod warnings;

use serde::Serialize;

pub use rows::Row;

use super::loops::Loops;
use super::margins::Margins;
use crate::base::axis::AxisId;
use crate::base::units::{Position, Velocity};
use crate::config::Machine;
use crate::config::bus_load::BusLoad;
use crate::config::machine::AXIS_NAMES;

/// The circle that is predicted: the paper's.
pub const RADIUS: Position = Position::mm(150.0);
/// Feed on it.
pub const FEED: Velocity = Velocity::mm_per_min(2000.0);

/// What a machine implies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MachineReport {
    /// Name of the machine.
    pub machine: String,
    /// Its file, or `NAME (embedded)`.
    pub source: String,
    /// Time and bus.
    pub cycle: CycleReport,
    /// The axes, in order.
    pub axes: Vec<AxisReport>,
    /// What to look at twice, in order of the file's sections.
    pub warnings: Vec<Warning>,
}

/// How a period is spent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CycleReport {
    /// Period of the velocity loop, `T_v`.
    pub period_us: f64,
    /// Period of the position loop, `T_p`.
    pub position_period_us: f64,
    /// SYNC and feedback of every axis on the wire, at most.
    pub replies_us: f64,
    /// Time that the replies have.
    pub reply_window_us: f64,
    /// Commands of every axis on the wire, at most.
    pub commands_us: f64,
    /// Time that computation and commands have after the window.
    pub after_window_us: f64,
    /// Frames of a cycle.
    pub frames: usize,
    /// Share of the bus that a cycle's frames take, at most.
    pub bus_load_percent: f64,
}

/// What holds for an axis with any gains.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisReport {
    /// Its name.
    pub axis: String,
    /// Node of its board.
    pub node: u8,
    /// Hash that the board must report, hexadecimal.
    pub firmware_config_hash: String,
    /// All that delays the velocity loop, but the current loop.
    pub dead_time_us: f64,
    /// Motor and table against each other on the screw.
    pub resonance_hz: f64,
    /// Of the screw under sliding friction, `F_low / K`.
    pub wind_up_um: f64,
    /// Of the table against the motor at a reversal, `2 F_low / K` and the backlash.
    pub lost_motion_um: f64,
    /// Current that tears a standing table loose.
    pub breakaway_current_a: f64,
    /// At the velocity limit.
    pub motor_speed_rpm: f64,
    /// Velocity that one count of the motor encoder shows as in one period.
    pub velocity_step_mm_per_s: f64,
    /// The gain sets, in order.
    pub gain_sets: Vec<GainSetReport>,
}

/// What an axis does with a gain set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GainSetReport {
    /// Its name.
    pub gains: String,
    /// Velocity loop, at its real delays.
    pub velocity_loop: Margins,
    /// Position loop around it.
    pub position_loop: Margins,
    /// Of the velocity loop without delays, around motor and screw.
    pub damping: f64,
    /// The same around all that moves.
    pub damping_with_table: f64,
    /// On a circle of [`RADIUS`] at [`FEED`], at the motor and without friction.
    pub radius_decrease_um: f64,
    /// In steady motion at [`FEED`].
    pub following_error_mm: f64,
}

/// Something right by itself that an engineer should look at twice.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Key of the machine file it is about.
    pub key: String,
    /// What, with value, bound and unit.
    pub message: String,
}

impl MachineReport {
    /// What a machine implies.
    pub fn of(machine: &Machine) -> Self {
        let cycle = CycleReport::of(machine);
        let axes: Vec<AxisReport> = machine.axes.axes().map(|axis| AxisReport::of(machine, axis)).collect();
        let warnings = warnings::of(machine, &axes);
        Self { machine: machine.name.clone(), source: machine.source.clone(), cycle, axes, warnings }
    }
}

impl CycleReport {
    fn of(machine: &Machine) -> Self {
        let load = BusLoad::of(machine);
        let period_us = machine.cycle.period.as_us();
        let reply_window_us = machine.cycle.reply_window.as_us();
        Self {
            period_us,
            position_period_us: period_us * f64::from(machine.cycle.position_every),
            replies_us: load.replies_s * 1e6,
            reply_window_us,
            commands_us: load.commands_s * 1e6,
            after_window_us: period_us - reply_window_us,
            frames: load.frames,
            bus_load_percent: load.share * 100.0,
        }
    }
}

impl AxisReport {
    fn of(machine: &Machine, id: AxisId) -> Self {
        let axis = &machine.axes[id];
        let (mechanics, friction) = (&axis.plant.mechanics, &axis.plant.friction);
        let wind_up_um = mechanics.wind_up(friction.sliding).as_um();
        let breakaway = mechanics.torque_for_force(friction.breakaway);
        let turns_per_s = axis.control.limits.velocity.as_m_per_s() / mechanics.lead_m;
        let step_m = mechanics.lead_m / f64::from(axis.sheet.motor_counts_per_rev);
        let gain_sets: Vec<GainSetReport> = machine
            .gain_sets
            .iter()
            .zip(0_u8..)
            .map(|(name, set)| GainSetReport::of(name, &Loops::new(machine, id, set)))
            .collect();
        Self {
            axis: AXIS_NAMES[id.index()].to_owned(),
            node: axis.node.number(),
            firmware_config_hash: format!("{:08x}", axis.sheet.firmware_config_hash()),
            dead_time_us: Loops::new(machine, id, 0).dead_time_s() * 1e6,
            resonance_hz: mechanics.resonance_hz(),
            wind_up_um,
            lost_motion_um: 2.0 * wind_up_um + mechanics.backlash_m * 1e6,
            breakaway_current_a: axis.plant.actuator.current(breakaway).as_a(),
            motor_speed_rpm: turns_per_s * 60.0,
            velocity_step_mm_per_s: step_m * 1e3 / machine.cycle.period.as_s(),
            gain_sets,
        }
    }
}

impl GainSetReport {
    fn of(name: &str, loops: &Loops<'_>) -> Self {
        Self {
            gains: name.to_owned(),
            velocity_loop: loops.velocity_margins(),
            position_loop: loops.position_margins(),
            damping: loops.damping(),
            damping_with_table: loops.damping_with_table(),
            radius_decrease_um: loops.radius_decrease(RADIUS, FEED).as_um(),
            following_error_mm: loops.following_error(FEED).as_mm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    fn report(name: &str) -> MachineReport {
        MachineReport::of(&config::load(name).expect("an embedded machine is sound"))
    }

    #[test]
    fn the_paper_machine_implies_what_the_paper_shows() {
        let report = report("paper");
        let x = &report.axes[0];
        assert!((x.wind_up_um - 6.30).abs() < 0.005, "wind-up {} um", x.wind_up_um);
        assert!((x.lost_motion_um - 12.60).abs() < 0.005, "lost motion {} um", x.lost_motion_um);
        for (set, damping) in x.gain_sets.iter().zip([0.709, 0.466]) {
            assert!((set.damping - damping).abs() < 5e-4, "{}: damping {}", set.gains, set.damping);
            assert!((set.radius_decrease_um - 49.99).abs() < 0.01, "{} um", set.radius_decrease_um);
        }
    }

    #[test]
    fn the_axes_of_a_machine_of_twins_are_reported_alike() {
        let report = report("reference");
        let [x, y] = &report.axes[..] else { panic!("two axes") };
        assert_eq!(x.gain_sets, y.gain_sets);
        assert_eq!((x.axis.as_str(), y.axis.as_str(), x.node, y.node), ("x", "y", 1, 2));
    }

    #[test]
    fn the_bus_load_is_the_share_of_the_period() {
        let cycle = report("reference").cycle;
        let share = 100.0 * (cycle.replies_us + cycle.commands_us) / cycle.period_us;
        assert!((cycle.bus_load_percent - share).abs() < 1e-9, "{cycle:?}");
        assert_eq!(cycle.frames, 5, "SYNC, two feedbacks, two commands");
    }
}
