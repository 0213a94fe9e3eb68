//! The machine file of a case: what its owner believes, in the product's format.
//!
//! Gains and limits are exact. `v-p` is always 100, the scale of the loop is in `a`.
//! Invariant: every key that the product requires, and none of an effect.

use std::fmt::Write;

use crate::machine::{AxisDesign, CURRENT_MAX, Machine};
use crate::plant::Plant;

const V_P: f64 = 100.0;
const HEAD: &str = r#"
[cycle]
period-us = 500
position-loop-every-cycles = 4
reply-window-us = 300

[real-time]
priority = 80

[bus]
format = "fd"
nominal-bit-rate-kbit-per-s = 1000
data-bit-rate-kbit-per-s = 5000

[supervision]
stale-cycles-max = 2
heartbeat-timeout-ms = 350
enable-timeout-ms = 1000
stop-timeout-ms = 5000
pause-cycles-max = 8
overrun-misses-max = 60
overrun-drain-cycles = 50
bus-losses-max = 20
bus-loss-drain-cycles = 100

[motion]
positioning-feed-mm-per-min = 6000.0
path-acceleration-m-per-s2 = 0.5
"#;

/// The text of the file; `told` is what is believed of the axes.
pub fn text(machine: &Machine, told: &[Plant; 2], has_table: bool) -> String {
    let mut text = format!("name = \"{}\"\n{HEAD}", machine.name);
    for (n, name) in ["x", "y"].iter().enumerate() {
        axis(&mut text, name, n + 1, &machine.axes[n], &told[n], has_table).expect("a string takes all text");
    }
    text
}

fn axis(
    text: &mut String,
    name: &str,
    node: usize,
    design: &AxisDesign,
    told: &Plant,
    has_table: bool,
) -> std::fmt::Result {
    let AxisDesign { control, sensors, .. } = design;
    let mut section = |title: &str, keys: &[(&str, String)]| {
        writeln!(text, "\n[axis.{name}.{title}]")?;
        keys.iter().try_for_each(|(key, value)| writeln!(text, "{key} = {value}"))
    };
    let word = |word: &str| format!("\"{word}\"");
    let number = |value: f64| format!("{value:?}");
    let whole = |value: f64| format!("{value:.0}");
    let applies = if control.delay == 0.0 { "on-receipt" } else { "on-next-sync" };
    section(
        "board",
        &[
            ("node", node.to_string()),
            ("sheet", word("encoder-board")),
            ("command-applies", word(applies)),
            ("feedback-latency-us", "0".to_owned()),
        ],
    )?;
    let finest = f64::from(1 << 28);
    let counts = if sensors.motor_count > 0.0 { told.lead / sensors.motor_count } else { finest };
    let estimate = if control.is_second_order { "second-order" } else { "difference" };
    section(
        "motor-encoder",
        &[("counts-per-rev", whole(counts)), ("sense", word("along")), ("velocity-estimate", word(estimate))],
    )?;
    if has_table {
        let counts = if sensors.table_count > 0.0 { 1e-3 / sensors.table_count } else { 1e7 };
        section("table-scale", &[("counts-per-mm", whole(counts)), ("sense", word("along"))])?;
    }
    section(
        "drive",
        &[
            ("torque-constant-nm-per-a", number(told.torque_constant)),
            ("current-loop-hz", number(told.current_loop_hz)),
            ("dead-time-us", "0".to_owned()),
            ("peak-current-a", number(1.25 * CURRENT_MAX)),
            ("current-noise-a-rms", number(sensors.current_noise)),
        ],
    )?;
    section(
        "mechanics",
        &[
            ("mass-kg", number(told.mass)),
            ("stiffness-n-per-um", number(told.stiffness * 1e-6)),
            ("damping-n-s-per-mm", number(told.damping * 1e-3)),
            ("motor-inertia-kg-m2", number(told.inertia)),
            ("lead-mm", number(told.lead * 1e3)),
            ("efficiency", number(told.efficiency)),
            ("backlash-um", number(0.0)),
        ],
    )?;
    section(
        "friction",
        &[
            ("variant", word("nonlinear")),
            ("breakaway-n", number(told.breakaway)),
            ("sliding-n", number(told.sliding)),
            ("fall-end-mm-per-s", number(told.fall_end * 1e3)),
            ("fall-start-mm-per-s", number(told.fall_start * 1e3)),
            ("viscous-n-s-per-mm", number(told.viscous * 1e-3)),
        ],
    )?;
    section(
        "velocity-loop",
        &[
            ("form", word("integrator")),
            ("a-nm-s-per-rad", number(control.proportional / V_P)),
            ("b-per-t-per-s", number(control.integral / control.proportional)),
        ],
    )?;
    section(
        "gains.standard",
        &[
            ("kp-per-s", number(control.position_gain)),
            ("v-p", number(V_P)),
            ("v-i", number(1.0)),
            ("velocity-feed-forward", number(control.velocity_feed_forward)),
            ("friction-feed-forward", number(0.0)),
            ("inertia-feed-forward", number(0.0)),
        ],
    )?;
    section(
        "limits",
        &[
            ("travel-min-mm", number(-250.0)),
            ("travel-max-mm", number(250.0)),
            ("travel-margin-mm", number(5.0)),
            ("velocity-mm-per-s", number(1000.0)),
            ("acceleration-m-per-s2", number(20.0)),
            ("current-a", number(control.current_max)),
            ("following-error-mm", number(50.0)),
            ("standstill-mm-per-s", number(0.5)),
        ],
    )
}
