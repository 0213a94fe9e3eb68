//! The survey as a page in Markdown.
//!
//! Invariant: the same lines give the same bytes.

use std::fmt::Write as _;

use super::{Extent, FEED, Line, RADIUS, Survey};
use crate::base::units::Position;
use crate::sim::script::Effect;

const COLUMNS: &str = "\
| fault | how | outcome: runs | no current on the axis, cycles: median / max | all at rest, cycles: median / max \
| position error acted on, um | off the circle, um | current by an old command, cycles |
|---|---|---|---|---|---|---|---|
";

/// The page.
pub fn page(survey: &Survey, lines: &[Line]) -> String {
    let mut text = head(survey);
    text += "\n## Carried on with wrong data\n\n";
    text += &carried_on(lines);
    text += "\n## Outcomes\n\n";
    text += COLUMNS;
    lines.iter().for_each(|line| text += &row(line));
    text += "\n";
    text += &legend(survey);
    text
}

fn head(survey: &Survey) -> String {
    let Survey { machine, seed, moments, .. } = survey;
    format!(
        "\
# What becomes of each fault

Machine `{}`, gains `{}`, a circle of {} mm radius at {:.0} mm/min, run in memory with the
shipped control. Each fault strikes at {moments} moments of the circle, the axes in turn (seed {seed}). This page is
the output of `quadrant hil survey`; a test compares it.

A position that is wrong by up to {} um can be a motion of the motor and may stay unseen
([fault 11](faults/11-encoder-jump.md)); behind an encoder that stands still it is up to {:.0} um
([fault 20](faults/20-no-response.md)). What is more wrong must stop the axis.
",
        machine.name,
        machine.gain_sets.first().map_or("", String::as_str),
        RADIUS.as_mm(),
        FEED.as_mm_per_min(),
        um(survey.unseen(&Effect::EncoderJump(Position::ZERO))),
        survey.unseen(&Effect::EncoderFrozen).as_um(),
    )
}

fn carried_on(lines: &[Line]) -> String {
    let mut text = String::new();
    for run in lines.iter().flat_map(|line| &line.carried_on) {
        let axis = run.axis.as_ref().map_or("the bus".to_owned(), |axis| format!("axis {axis}"));
        let _infallible = writeln!(
            text,
            "* {} ({}) on {axis} at {:.4} s: {}, {} um wrong, {} um may stay unseen",
            run.fault,
            run.how,
            run.at_s,
            run.outcome,
            um(Position::um(run.position_error_um)),
            um(Position::um(run.unseen_um)),
        );
    }
    if text.is_empty() { "In no run.\n".to_owned() } else { text }
}

/// The row of a line.
pub fn row(line: &Line) -> String {
    let outcomes: Vec<String> =
        line.outcomes.iter().map(|(outcome, runs)| format!("{outcome}: {runs}")).collect();
    format!(
        "| {} | {} | {} | {} | {} | {} | {} | {} |\n",
        line.fault,
        line.how,
        outcomes.join(", "),
        extent(line.current_zero_cycles),
        extent(line.rest_cycles),
        line.position_error.map_or("-".to_owned(), um),
        line.off_circle.map_or("-".to_owned(), |length| format!("{:.0}", length.as_um())),
        line.old_command_cycles,
    )
}

fn extent(extent: Option<Extent>) -> String {
    let told = |cycles: Option<u64>| cycles.map_or("never".to_owned(), |cycles| cycles.to_string());
    extent.map_or("-".to_owned(), |extent| format!("{} / {}", told(extent.median), told(extent.max)))
}

/// Three digits or so of a length.
fn um(length: Position) -> String {
    let um = length.as_um();
    let digits = if um < 1.0 {
        3
    } else if um < 100.0 {
        1
    } else {
        0
    };
    format!("{um:.digits$}")
}

fn legend(survey: &Survey) -> String {
    let Survey { machine, off_circle, .. } = survey;
    let watchdog =
        machine.axes.as_slice().iter().map(|axis| axis.sheet.watchdog() / machine.cycle.period).max();
    format!(
        "\
Cycles, of {} us, count from the moment of the fault.

* *No current on the axis*: on the one that has a fault of its own.
* *All at rest*: the other axis, too, which is stopped under control where the bus lets the host do it.
* *Position error acted on*: largest difference between the true position of a motor and a fresh one that a
  closed loop used.
* *Off the circle*: the furthest that the true place was from the circle until all was at rest. Without a
  fault it is {} um, for the position loop lags. An axis without current coasts until friction has stopped it.
* *Current by an old command*: cycles in which a drive gave current by a command that another one should have
  followed by then. Where no command reaches a board, or no SYNC at which it would act, the host cannot take
  the current away; the watchdog of the board does, after {} cycles.
",
        machine.cycle.period.as_us(),
        um(*off_circle),
        watchdog.unwrap_or_default(),
    )
}
