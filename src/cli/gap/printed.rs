//! What `quadrant gap` prints, for people and for scripts.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use serde::Serialize;

use super::circles::Circle;
use super::effect::{Effect, Falsified, once, short};
use super::left::Left;
use crate::base::units::Current;
use crate::cli::view::table;
use crate::config::Machine;
use crate::offline::gap::analysis::Analysis;
use crate::offline::gap::gates::Gate;
use crate::offline::gap::locate::unit;
use crate::offline::gap::model::problem::SIGNALS;
use crate::offline::gap::model::zeros::Zeros;
use crate::offline::gap::runs::Run;
use crate::offline::gap::shortlist::smallest::Smallest;
use crate::offline::gap::show::answer::AxisGap;
use crate::offline::gap::show::verdict::{SignalGap, Verdict, excess_of_all};
use crate::offline::report::gap::NamedRow;

/// Columns of a terminal.
const WIDTH: usize = 110;

/// The answer as one object.
#[derive(Debug, Serialize)]
pub(super) struct Printed {
    verdict: Verdict,
    effects: Vec<Effect>,
    located: Vec<Located>,
    gap: Gap,
    /// Circular tests among the runs, measured and simulated.
    circles: Vec<Circle>,
    /// The machine file with the effects added; nothing where none was named.
    machine_after: Option<String>,
    /// The page, where one was asked for.
    pub(super) report: Option<PathBuf>,
    axes: BTreeMap<String, Axis>,
    /// Gain set of the runs.
    gains: String,
    repaired: Vec<String>,
    seconds: f64,
}

/// A coordinate over which what the base leaves has a shape.
#[derive(Debug, Serialize)]
struct Located {
    axis: String,
    signal: &'static str,
    coordinate: String,
    unit: &'static str,
    /// Of the variance of what is left.
    share: f64,
}

#[derive(Debug, Serialize)]
struct RunLeft {
    run: String,
    signal: &'static str,
    before: f64,
    after: f64,
}

#[derive(Debug, Serialize)]
struct Gap {
    before: BTreeMap<String, f64>,
    after: BTreeMap<String, f64>,
    floor: BTreeMap<String, f64>,
    heldout_closed_fraction: f64,
}

#[derive(Debug, Serialize)]
struct Axis {
    verdict: Verdict,
    left: Option<Left>,
    base: BTreeMap<&'static str, f64>,
    gap: Vec<SignalGap>,
    left_per_row: [f64; 2],
    /// Cost per row; noise is 1.
    runs: Vec<RunLeft>,
    refused: Vec<Refused>,
    /// By effect: its amplitude, the unit in the name, from which it would have been seen; nothing where these runs do not
    /// show it.
    seen_from: BTreeMap<&'static str, Option<BTreeMap<&'static str, f64>>>,
    /// What the loops alone do not explain of the current.
    controller_left_share: Option<f64>,
    /// How they see the velocity; and how the machine file says that they do, where that is another way.
    velocity_estimate: &'static str,
    velocity_estimate_filed: Option<&'static str>,
    /// Whether the noise of each signal is known from repeats; otherwise it is a lower bound.
    is_floor_from_repeats: BTreeMap<&'static str, bool>,
    /// Whether all runs have one zero of the table scale, or each its own; nothing where there is no scale.
    table_zeros: Option<Zeros>,
    /// By how much the torque shakes from pass to pass, rms as a current: where the axis sticks, that moves means.
    torque_noise_a: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Refused {
    name: &'static str,
    parameters: BTreeMap<&'static str, f64>,
    evidence: f64,
    failed: Vec<Gate>,
}

impl Printed {
    pub(super) fn new(
        machine: &Machine,
        runs: &[Run],
        analysis: &Analysis<'_>,
        repaired: Vec<String>,
        machine_after: Option<String>,
    ) -> Self {
        let names = machine.axis_names();
        let name = |gap: &AxisGap<'_>| names[gap.id.index()].clone();
        let mut gap = Gap {
            before: BTreeMap::new(),
            after: BTreeMap::new(),
            floor: BTreeMap::new(),
            heldout_closed_fraction: 1.0,
        };
        for axis in &analysis.axes {
            for signal in &axis.gap {
                let key = format!(
                    "{}.{}_{}",
                    name(axis),
                    signal.signal.replace(' ', "_"),
                    signal.unit.to_lowercase()
                );
                gap.before.insert(key.clone(), signal.before);
                gap.after.insert(key.clone(), signal.after);
                gap.floor.insert(key, signal.floor);
            }
        }
        let [before, after] = excess_of_all(analysis.axes.iter().flat_map(|axis| &axis.gap));
        if before > 0.0 {
            gap.heldout_closed_fraction = 1.0 - after / before;
        }
        let effects = analysis.axes.iter().flat_map(|axis| {
            let axis_name = name(axis);
            axis.named.effects.iter().enumerate().flat_map(move |(of, named)| {
                let axis_name = axis_name.clone();
                // What came next is no member of a class.
                let is_alone = named.class.len() == 1;
                let runner_up = named.runner_up.as_ref().filter(|_| is_alone);
                named.class.iter().enumerate().map(move |(rank, (candidate, _))| {
                    let others = named.members();
                    let alternatives = others
                        .filter(|other| *other != candidate.name())
                        .chain(runner_up.map(|next| next.name))
                        .collect();
                    // The likeliest beside all that was named later.
                    let (fitted, place) = match rank {
                        0 => (&axis.named.model, of),
                        _ => (&candidate.fitted, candidate.fitted.model.effects.len() - 1),
                    };
                    let confidence = named.confidence(rank);
                    let mut effect = Effect::new(axis_name.clone(), fitted, place, confidence, alternatives);
                    effect.told_apart_by = named.told_apart_by().map(|by| by.to_string());
                    effect.runner_up = runner_up.cloned();
                    if let (0, Some(follows)) = (rank, &axis.consequences[of]) {
                        effect.falsified_by = Some(Falsified::new(candidate, follows, runs));
                    }
                    effect
                })
            })
        });
        let effects = once(effects);
        let axes = analysis.axes.iter().map(|axis| {
            let [fit, held] = axis.named.rows;
            let refused = axis.named.refused.iter().map(|candidate| Refused {
                name: candidate.name(),
                parameters: candidate.values().collect(),
                evidence: candidate.evidence,
                failed: candidate.failed.clone(),
            });
            let filed = machine.axes[axis.id].velocity_estimate;
            let other = axis.other_estimate();
            let model = &axis.named.model.model;
            let values = model.base_values().into_iter().map(|(base, value)| (base.name, value));
            // What has no name stays with the base.
            let unnamed = model.effects.iter().skip(axis.named.effects.len());
            let unnamed = unnamed.filter(|tried| !tried.entry.is_parameter());
            let printed = Axis {
                verdict: axis.verdict,
                left: axis.rest.as_ref().map(Left::new),
                base: values.chain(unnamed.map(|tried| (tried.entry.name, tried.values[0]))).collect(),
                gap: axis.gap.clone(),
                left_per_row: [
                    axis.named.model.cost / fit.max(1) as f64,
                    axis.named.held()[1] / held.max(1) as f64,
                ],
                runs: axis
                    .runs_left
                    .iter()
                    .map(|left| RunLeft {
                        run: runs[left.run].name.clone(),
                        signal: SIGNALS[left.signal].0,
                        before: left.per_row[0],
                        after: left.per_row[1],
                    })
                    .collect(),
                refused: refused.collect(),
                seen_from: axis.named.smallest.iter().map(seen_from).collect(),
                controller_left_share: axis.controller.map(|found| found.left_share),
                velocity_estimate: other.unwrap_or(filed).name(),
                velocity_estimate_filed: other.map(|_| filed.name()),
                is_floor_from_repeats: SIGNALS
                    .iter()
                    .zip(&axis.problem.noises)
                    .filter_map(|((signal, ..), noise)| Some((*signal, noise.as_ref()?.is_from_repeats)))
                    .collect(),
                table_zeros: axis.problem.has_table().then(|| axis.problem.zeros()),
                torque_noise_a: axis.problem.torque_noise().map(Current::as_a),
            };
            (name(axis), printed)
        });
        Self {
            verdict: analysis.axes.iter().map(|axis| axis.verdict).max().unwrap_or(Verdict::Insufficient),
            effects,
            located: analysis
                .axes
                .iter()
                .flat_map(|axis| {
                    axis.located.iter().map(|located| Located {
                        axis: name(axis),
                        signal: SIGNALS[located.signal].0,
                        coordinate: located.coordinate.to_string(),
                        unit: unit(located.coordinate),
                        share: located.share,
                    })
                })
                .collect(),
            gap,
            circles: analysis.contours.iter().map(|contour| Circle::new(contour, runs)).collect(),
            machine_after,
            report: None,
            axes: axes.collect(),
            gains: analysis.gains.clone(),
            repaired,
            seconds: analysis.seconds,
        }
    }

    /// What was named, for a page.
    pub(super) fn rows(&self) -> Vec<NamedRow> {
        let of = |effect: &Effect| NamedRow { cells: effect.cells(), sentences: effect.sentences() };
        self.effects.iter().map(of).collect()
    }

    pub(super) fn text(&self) -> String {
        let mut text = format!("runs under gain set \"{}\"\n", self.gains);
        for (name, axis) in &self.axes {
            let _ = writeln!(text, "axis {name}: {}", axis.verdict);
            if axis.is_floor_from_repeats.values().any(|is_told| !is_told) {
                let _ = writeln!(
                    text,
                    "  nothing here comes again, so that noise is a lower bound: record each command at least twice"
                );
            }
            if let Some(filed) = axis.velocity_estimate_filed {
                let seen = axis.velocity_estimate;
                let _ = writeln!(
                    text,
                    "  its loops estimate the velocity by \"{seen}\": the current is not that of \"{filed}\", as the file says"
                );
            }
            let mut table = table(&["rms", "unit", "as filed", "base fitted", "with effects", "noise"]);
            for signal in &axis.gap {
                let values = [signal.file, signal.before, signal.after, signal.floor];
                let cells = [signal.signal.to_owned(), signal.unit.to_owned()];
                table.add_row(cells.into_iter().chain(values.map(|value| format!("{value:.4}"))));
            }
            let _ = writeln!(text, "{table}");
            if let Some(noise_a) = axis.torque_noise_a {
                let _ = writeln!(
                    text,
                    "  its torque shakes by {} A rms: simulated, as that moves means",
                    short(noise_a)
                );
            }
            if let (Verdict::Unknown, Some(most)) = (axis.verdict, axis.most_left()) {
                let RunLeft { run, signal, after, .. } = most;
                let _ = writeln!(
                    text,
                    "  most is left in {run}: {signal}, {after:.1} per row where noise leaves 1"
                );
            }
            if let Some(left) = &axis.left {
                let _ = writeln!(text, "  {}", left.sentence);
            }
            for effect in self.effects.iter().filter(|effect| effect.axis == *name) {
                let _ = writeln!(text, "  {effect}");
            }
            // The others explain nothing.
            for refused in axis.refused.iter().filter(|refused| !refused.failed.contains(&Gate::Fit)) {
                let against: Vec<String> = refused.failed.iter().map(ToString::to_string).collect();
                let _ = writeln!(text, "  not named: {}, which {}", refused.name, against.join(", "));
            }
            let _ = writeln!(text, "{}", axis.seen_text());
        }
        for circle in self.circles.iter().filter(|circle| circle.is_held_out) {
            let _ = writeln!(text, "{circle}");
        }
        if !self.effects.is_empty() {
            let closed = 100.0 * self.gap.heldout_closed_fraction;
            let _ = writeln!(text, "closed on rows not fitted: {closed:.1} %");
        }
        text
    }
}

impl Axis {
    /// The signal of a run of which most is left, where that is more than noise.
    fn most_left(&self) -> Option<&RunLeft> {
        self.runs.iter().filter(|run| run.after > 1.0).max_by(|a, b| a.after.total_cmp(&b.after))
    }

    /// What else would have been seen.
    fn seen_text(&self) -> String {
        let (seen, hidden): (Vec<_>, Vec<_>) = self.seen_from.iter().partition(|(_, from)| from.is_some());
        let from = |(name, from): (&&str, &Option<BTreeMap<&str, f64>>)| -> Vec<String> {
            from.iter().flatten().map(|(key, value)| format!("{name} {key} {}", short(*value))).collect()
        };
        let seen = seen.into_iter().flat_map(|(name, value)| from((name, value)));
        let mut text = listed("  would have been seen from:", seen);
        if !hidden.is_empty() {
            text.push('\n');
            text +=
                &listed("  these runs do not show:", hidden.into_iter().map(|(name, _)| (*name).to_owned()));
        }
        text
    }
}

/// A list in lines that fit a terminal.
fn listed(title: &str, items: impl Iterator<Item = String>) -> String {
    let (mut text, mut width) = (title.to_owned(), title.len());
    let mut items = items.peekable();
    while let Some(mut item) = items.next() {
        if items.peek().is_some() {
            item.push(',');
        }
        if width + 1 + item.len() > WIDTH {
            text += "\n   ";
            width = 3;
        }
        width += 1 + item.len();
        text.push(' ');
        text += &item;
    }
    text
}

fn seen_from(smallest: &Smallest) -> (&'static str, Option<BTreeMap<&'static str, f64>>) {
    (smallest.name, smallest.amplitude.map(|amplitude| BTreeMap::from([(smallest.key, amplitude)])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits_and_lists_the_width_of_a_terminal() {
        assert_eq!(
            [1.8654, 2209.7, 0.002_081, 0.0, -39.77].map(short),
            ["1.87", "2210", "0.00208", "0", "-39.8"]
        );
        let text = listed("  these:", (0..40).map(|item| format!("item-{item}")));
        assert!(text.lines().count() > 2 && text.lines().all(|line| line.len() <= WIDTH), "{text}");
        assert!(text.ends_with("item-38, item-39"), "{text}");
    }
}
