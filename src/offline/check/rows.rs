//! The numbers of a report by name, with sensible digits and their unit: the lines of a table.
//!
//! Invariant: every row of a kind is there in every report, so that axes and gain sets stand side by side.

use super::{AxisReport, CycleReport, GainSetReport};

/// A named number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// What it is.
    pub name: &'static str,
    /// With sensible digits; `none` where it does not exist.
    pub value: String,
    /// Of the value; empty for pure numbers.
    pub unit: &'static str,
}

fn row(name: &'static str, value: impl Into<Option<f64>>, digits: usize, unit: &'static str) -> Row {
    let value = match value.into() {
        Some(value) if value.is_finite() => format!("{value:.digits$}"),
        _ => "none".to_owned(),
    };
    Row { name, value, unit }
}

impl CycleReport {
    /// As lines of a table.
    pub fn rows(&self) -> Vec<Row> {
        vec![
            row("period, velocity loop", self.period_us, 0, "us"),
            row("period, position loop", self.position_period_us, 0, "us"),
            row("SYNC and feedback on the wire, at most", self.replies_us, 0, "us"),
            row("reply window", self.reply_window_us, 0, "us"),
            row("commands on the wire, at most", self.commands_us, 0, "us"),
            row("after the window", self.after_window_us, 0, "us"),
            row("frames in a cycle", self.frames as f64, 0, ""),
            row("bus load, at most", self.bus_load_percent, 1, "%"),
        ]
    }
}

impl AxisReport {
    /// As lines of a table.
    pub fn rows(&self) -> Vec<Row> {
        vec![
            row("node", f64::from(self.node), 0, ""),
            Row { name: "firmware-config hash", value: self.firmware_config_hash.clone(), unit: "" },
            row("dead time of the velocity loop", self.dead_time_us, 0, "us"),
            row("resonance of motor and table", self.resonance_hz, 1, "Hz"),
            row("wind-up of the screw, F_low / K", self.wind_up_um, 2, "um"),
            row("lost motion at reversal, 2 F_low / K + backlash", self.lost_motion_um, 2, "um"),
            row("current at break-away", self.breakaway_current_a, 2, "A"),
            row("motor speed at the velocity limit", self.motor_speed_rpm, 0, "1/min"),
            row("velocity step of one count", self.velocity_step_mm_per_s, 4, "mm/s"),
        ]
    }
}

impl GainSetReport {
    /// As lines of a table.
    pub fn rows(&self) -> Vec<Row> {
        let (velocity, position) = (&self.velocity_loop, &self.position_loop);
        vec![
            row("velocity loop: crossover", velocity.crossover_hz, 1, "Hz"),
            row("  phase margin", velocity.phase_margin_deg, 1, "deg"),
            row("  gain margin", velocity.gain_margin_db, 1, "dB"),
            row("  peak sensitivity Ms", velocity.sensitivity_max, 2, ""),
            row("  bandwidth, -3 dB", velocity.bandwidth_hz, 1, "Hz"),
            row("  damping, motor and screw", self.damping, 3, ""),
            row("  damping, with table", self.damping_with_table, 3, ""),
            row("position loop: crossover", position.crossover_hz, 2, "Hz"),
            row("  phase margin", position.phase_margin_deg, 1, "deg"),
            row("  gain margin", position.gain_margin_db, 1, "dB"),
            row("  bandwidth, -3 dB", position.bandwidth_hz, 2, "Hz"),
            row("radius decrease, 150 mm at 2000 mm/min", self.radius_decrease_um, 2, "um"),
            row("following error at 2000 mm/min", self.following_error_mm, 3, "mm"),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_exist_is_said_to_be_none() {
        assert_eq!(row("gain margin", None, 1, "dB").value, "none");
        assert_eq!(row("damping", f64::INFINITY, 3, "").value, "none");
        assert_eq!(row("crossover", 36.24, 1, "Hz").value, "36.2");
    }
}
