//! Tables for the terminal.

use std::collections::BTreeMap;

use comfy_table::{CellAlignment, Table, presets};
use serde_json::Value;

use crate::base::axis::AxisId;
use crate::base::units::Position;
use crate::config::Machine;
use crate::config::machine::AXIS_NAMES;
use crate::log::header::IMPORTED;
use crate::log::timing::Share;
use crate::log::{Header, Summary};
use crate::offline::autotune::CircleFigures;
use crate::offline::check::{MachineReport, Row};
use crate::offline::circle::{CircularTest, PointAnalysis, Quadrant};
use crate::offline::identify::frequency::AxisResponse;
use crate::offline::identify::plan::{Part, Purpose};
use crate::offline::identify::{Estimate, Finding, Findings};
use crate::offline::report::TestSheet;
use crate::offline::tune::Judged;
use crate::rt::cycle::procedure::Programme;

/// A table with a left-hand column of names and right-aligned numbers.
pub(super) fn table(heads: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(heads);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

fn um(value: f64) -> String {
    format!("{value:.2}")
}

/// A number that may not be one.
fn known(value: f64, decimals: usize) -> String {
    if value.is_nan() { "not known".to_owned() } else { format!("{value:.decimals$}") }
}

/// Percentiles of the shares of a period.
pub(super) fn latency_table(shares: &[Share]) -> String {
    let mut rows = table(&["us", "p50", "p99", "p99.9", "p99.99", "max"]);
    for Share { name, percentiles: told, .. } in shares {
        let us = [told.p50_us, told.p99_us, told.p99_9_us, told.p99_99_us, told.max_us];
        rows.add_row(std::iter::once(name.clone()).chain(us.map(|us| format!("{us:.1}"))));
    }
    rows.to_string()
}

/// Name, before and after of figures.
pub(super) fn before_and_after(figures: &[[String; 3]]) -> String {
    let mut rows = table(&["", "before", "after"]);
    for row in figures {
        rows.add_row(row);
    }
    rows.to_string()
}

/// Gains that none is better than.
pub(super) fn front(objectives: &[&str], front: &[Judged]) -> String {
    let heads: Vec<&str> = objectives.iter().copied().chain(["V_p", "V_i", "K_p, 1/s"]).collect();
    let mut rows = table(&heads);
    for Judged { choice, objectives, .. } in front {
        let gains = [choice.v_p, choice.v_i, choice.kp_per_s];
        rows.add_row(objectives.iter().chain(&gains).map(|value| format!("{value:.3}")));
    }
    rows.to_string()
}

/// Where the axes go in a programme, from where they stand, and where they may go.
pub(super) fn reach(machine: &Machine, programme: &Programme) -> String {
    let line = |axis: AxisId| {
        let (low, high) = programme.reach(axis);
        let name = AXIS_NAMES[axis.index()];
        if low == high {
            return format!("  axis {name} stays where it stands\n");
        }
        let limits = &machine.axes[axis].control.limits;
        let [low, high, least, most] = [low, high, limits.travel_min, limits.travel_max].map(Position::as_mm);
        format!(
            "  axis {name} moves between {low:.1} and {high:.1} mm from where it stands; its travel is {least:.1} to \
             {most:.1} mm\n"
        )
    };
    machine.axes.axes().map(line).collect()
}

/// How fast a programme is, and how long it takes.
pub(super) fn pace_of(programme: &Programme, duration_s: f64) -> String {
    format!(
        "  up to {:.0} mm/min and {:.2} m/s2 along the path, about {duration_s:.0} s\n",
        programme.velocity_max().as_mm_per_min(),
        programme.acceleration_max().as_m_per_s2()
    )
}

/// A circle in one line.
pub(super) fn circle_line(figures: &CircleFigures) -> String {
    let axes = figures.axes.iter().map(|axis| {
        let table = axis.table_deviation_um.map(|um| format!(" ({um:.2} at the table)")).unwrap_or_default();
        format!("{} {:.2} um{table} and {:.2} A", axis.axis, axis.deviation_um, axis.current_a_max)
    });
    format!(
        "protrusion {:.2} um, radius {:.2} um smaller; from the orbit {}",
        figures.protrusion_um,
        figures.radius_decrease_um,
        axes.collect::<Vec<_>>().join(", ")
    )
}

/// What the experiments of each purpose do.
pub(super) fn experiments(parts: &BTreeMap<Purpose, Part>) -> String {
    let mut rows = table(&["experiment", "motions", "way", "up to", "time"]);
    for (purpose, part) in parts {
        rows.add_row([
            purpose.name().to_owned(),
            part.motions.to_string(),
            format!("{:.0} mm", part.way_mm),
            format!("{:.2} mm/s", part.top_speed_mm_per_s),
            format!("{:.0} s", part.duration_s),
        ]);
    }
    rows.to_string()
}

/// Margins of velocity loops, as measured beside as computed.
pub(super) fn loop_margins(axes: &BTreeMap<String, AxisResponse>) -> String {
    let mut rows = table(&["velocity loop", "crossover", "phase margin", "gain margin", "Ms", "bandwidth"]);
    for (axis, response) in axes {
        let both = [("measured", &response.measured), ("computed", &response.computed)];
        for (how, margins) in both {
            let told = |value: Option<f64>, unit| {
                value.map_or("none".to_owned(), |value| format!("{value:.1} {unit}"))
            };
            rows.add_row([
                format!("{axis}, {how}"),
                told(margins.crossover_hz, "Hz"),
                told(margins.phase_margin_deg, "deg"),
                told(margins.gain_margin_db, "dB"),
                format!("{:.2}", margins.sensitivity_max),
                told(margins.bandwidth_hz, "Hz"),
            ]);
        }
    }
    rows.to_string()
}

/// Parameters of axes with their intervals; what is not known says what it needs.
pub(super) fn findings(found: &Findings) -> String {
    let mut rows = table(&["parameter", "value", "95 % interval", "unit", "from"]);
    for (axis, parameters) in found {
        for (name, finding) in parameters {
            let name = format!("{axis}.{name}");
            match finding {
                Finding::Found(Estimate { value, ci95: [low, high], unit, source }) => {
                    let decimals = decimals_for(high - low);
                    let [value, low, high] = [value, low, high].map(|number| format!("{number:.decimals$}"));
                    rows.add_row([
                        name,
                        value,
                        format!("{low} to {high}"),
                        (*unit).to_owned(),
                        source.clone(),
                    ])
                }
                Finding::Unknown { needs, .. } => {
                    let none = || "-".to_owned();
                    rows.add_row([name, "not known".to_owned(), none(), none(), needs.clone()])
                }
            };
        }
    }
    rows.column_iter_mut().skip(3).for_each(|column| column.set_cell_alignment(CellAlignment::Left));
    rows.to_string()
}

/// Digits behind the point that an interval of this width justifies: two of its own.
fn decimals_for(width: f64) -> usize {
    if width > 0.0 { (1.0 - width.log10().floor()).clamp(0.0, 9.0) as usize } else { 3 }
}

/// Result of a circular test.
pub(super) fn circle_table(sheet: &TestSheet, test: &CircularTest) -> String {
    let senses: Vec<&str> = test.motor.directions.iter().map(|run| run.direction.name()).collect();
    let title = format!(
        "Circular test on machine {}, {} gains: radius {} mm, {} mm/min, {}",
        sheet.machine,
        sheet.gains,
        test.radius_mm,
        test.feed_mm_per_min.round(),
        senses.join(" and ")
    );
    let heads: Vec<&str> =
        std::iter::once("um").chain(test.points().map(|point| point.point.name())).collect();
    let mut rows = table(&heads);
    let mut row = |name: String, value: &dyn Fn(&PointAnalysis) -> Option<f64>| {
        let cells = test.points().map(|point| value(point).map_or("-".to_owned(), um));
        rows.add_row(std::iter::once(name).chain(cells));
    };
    row("protrusion, highest".to_owned(), &|point| Some(point.protrusion_um.max));
    for quadrant in Quadrant::ALL {
        let name = format!("  at {} ({:.0} deg)", quadrant.label(), quadrant.angle_deg());
        row(name, &|point| Some(point.protrusion_um.of_quadrant(quadrant)));
    }
    row("radius decrease".to_owned(), &|point| Some(point.radius_decrease_um));
    row("circular deviation G".to_owned(), &|point| Some(point.circular_deviation_um));
    row("bidirectional circular deviation G(b)".to_owned(), &|point| {
        point.bidirectional_circular_deviation_um
    });
    for (index, sense) in senses.iter().enumerate() {
        let values = move |point: &PointAnalysis| point.directions[index].values.clone();
        row(format!("radial deviation F max, {sense}"), &|point| Some(values(point).radial_deviation_um_max));
        row(format!("radial deviation F min, {sense}"), &|point| Some(values(point).radial_deviation_um_min));
    }
    let mut lines = format!("{title}\n\n{rows}\n");
    if !sheet.expectations.is_empty() {
        let mut rows = table(&["compared with the paper, um", "measured", "expected", "within", ""]);
        for expectation in &sheet.expectations {
            rows.add_row([
                expectation.quantity.clone(),
                um(expectation.measured_um),
                format!("{:.1}", expectation.expected_um),
                format!("{}", expectation.tolerance_um),
                if expectation.is_met() { "yes" } else { "NO" }.to_owned(),
            ]);
        }
        lines += &format!("\n{rows}\n");
    }
    lines += &format!(
        "\n{} cycles, {} overruns, {} lost records ({})\n",
        sheet.cycles, sheet.overruns, sheet.lost_records, sheet.pace
    );
    if test.missing_cycles > 0 {
        lines += &format!("note: {} cycles are missing\n", test.missing_cycles);
    }
    if test.stale_samples > 0 {
        lines +=
            &format!("note: {} samples were not fresh in their cycle and are left out\n", test.stale_samples);
    }
    for note in &sheet.notes {
        lines += &format!("note: {note}\n");
    }
    lines
}

/// What is in a log.
pub(super) fn log_table(started: &str, header: &Header, summary: &Summary) -> String {
    let mut facts = table(&["", ""]);
    let mut fact = |name: &str, value: String| {
        facts.add_row([name.to_owned(), value]);
    };
    fact("machine", header.machine_name.clone());
    fact("program", format!("{} ({})", header.project_version, header.commit));
    fact("started", started.to_owned());
    fact("pace, seed", format!("{}, {}", header.pace.name(), header.seed));
    if let Some(note) = header.extra.get(IMPORTED) {
        fact("imported", note.clone());
    }
    fact("duration", format!("{:.3} s", summary.duration_s));
    fact("cycles", format!("{} of {} us", summary.cycles, header.period.as_us()));
    fact("missing cycles", format!("{} in {} gaps", summary.cycles_missing, summary.gaps));
    fact("lost records", summary.lost_records.to_string());
    fact("overruns", summary.overruns.to_string());
    let wake_error = if header.extra.contains_key(IMPORTED) {
        "not known".to_owned()
    } else {
        format!("99 %: {:.1} us, max {:.1} us", summary.wake_error_us_p99, summary.wake_error_us_max)
    };
    fact("wake-up error", wake_error);
    for (number, motion) in header.motions.iter().take(MOTIONS_SHOWN) {
        fact(&format!("motion {number}"), motion_in_words(motion));
    }
    let more = header.motions.len().saturating_sub(MOTIONS_SHOWN);
    if more > 0 {
        fact("", format!("and {more} more, all of them with --json"));
    }
    facts.column_iter_mut().for_each(|column| column.set_cell_alignment(CellAlignment::Left));
    let mut axes = table(&["axis", "following error, um", "current, A", "cycles by mode"]);
    for axis in &summary.axes {
        let modes: Vec<String> =
            axis.cycles_by_mode.iter().map(|(mode, cycles)| format!("{mode} {cycles}")).collect();
        axes.add_row([
            axis.name.clone(),
            known(axis.following_error_um_max, 1),
            format!("{:.2}", axis.current_a_max),
            modes.join(", "),
        ]);
    }
    let mut lines = format!("{facts}\n\n{axes}");
    for fault in &summary.faults {
        lines += &format!(
            "\naxis {}: fault {} ({}) in cycle {}, {:.4} s",
            fault.axis, fault.number, fault.name, fault.cycle, fault.at_s
        );
    }
    lines
}

/// Motions of a log that are told one by one.
const MOTIONS_SHOWN: usize = 12;
/// Longest list that is told value by value.
const LIST_SHOWN: usize = 3;

/// Units that keys end with, longer ones first.
const UNITS: [(&str, &str); 8] = [
    ("_mm_per_min", " mm/min"),
    ("_m_per_s2", " m/s2"),
    ("_mm_per_s", " mm/s"),
    ("_mm", " mm"),
    ("_um", " um"),
    ("_deg", " deg"),
    ("_ms", " ms"),
    ("_s", " s"),
];

/// What a header says of a motion: its kind first, then each key with its value.
fn motion_in_words(motion: &Value) -> String {
    let Value::Object(keys) = motion else { return value_in_words(motion) };
    let kind = keys.get("kind").map(value_in_words);
    let rest = keys.iter().filter(|(key, value)| *key != "kind" && !value.is_null());
    let rest = rest.map(|(key, value)| {
        let suffixed = UNITS.iter().find_map(|(suffix, unit)| Some((key.strip_suffix(suffix)?, unit)));
        let (name, unit) = suffixed.map_or((key.as_str(), ""), |(name, unit)| (name, *unit));
        format!("{} {}{unit}", name.replace('_', " "), value_in_words(value))
    });
    kind.into_iter().chain(rest).collect::<Vec<_>>().join(", ")
}

fn value_in_words(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "-".to_owned(),
        Value::Number(number) if number.is_f64() => {
            let text = format!("{:.4}", number.as_f64().unwrap_or(f64::NAN));
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        Value::Array(list) if list.len() <= LIST_SHOWN => {
            format!("({})", list.iter().map(value_in_words).collect::<Vec<_>>().join(", "))
        }
        Value::Array(list) => match list.as_slice() {
            [first, .., last] => {
                format!("{} values from {} to {}", list.len(), value_in_words(first), value_in_words(last))
            }
            [_] | [] => String::new(),
        },
        Value::Bool(_) | Value::Number(_) | Value::Object(_) => value.to_string(),
    }
}

/// What a machine file implies: the cycle, each axis, its gain sets side by side, what to look at twice.
pub(super) fn machine_tables(report: &MachineReport) -> String {
    let mut lines = format!("{} is right: machine {}\n", report.source, report.machine);
    lines += &format!("\n{}\n", rows_table("cycle", &[("", report.cycle.rows())]));
    for axis in &report.axes {
        lines += &format!("\n{}\n", rows_table(&format!("axis {}", axis.axis), &[("", axis.rows())]));
        let sets: Vec<(&str, Vec<Row>)> =
            axis.gain_sets.iter().map(|set| (set.gains.as_str(), set.rows())).collect();
        lines += &format!("\n{}\n", rows_table(&format!("axis {}, gains", axis.axis), &sets));
    }
    for warning in &report.warnings {
        lines += &format!("\nwarning: {}: {}", warning.key, warning.message);
    }
    if !report.warnings.is_empty() {
        lines.push('\n');
    }
    lines
}

/// Rows of the same kind in columns side by side.
fn rows_table(title: &str, columns: &[(&str, Vec<Row>)]) -> Table {
    let heads: Vec<&str> =
        [title].into_iter().chain(columns.iter().map(|(head, _)| *head)).chain([""]).collect();
    let mut rows = table(&heads);
    if let Some(last) = rows.column_mut(heads.len() - 1) {
        last.set_cell_alignment(CellAlignment::Left);
    }
    let [(_, first), ..] = columns else { return rows };
    for (index, row) in first.iter().enumerate() {
        let values = columns.iter().map(|(_, rows)| rows[index].value.as_str());
        rows.add_row([row.name].into_iter().chain(values).chain([row.unit]));
    }
    rows
}
