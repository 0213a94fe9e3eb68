//! What is told of the steps: for programs, for people, on a page, and in the note above the gains.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::{Outcome, view};
use super::setup::Setup;
use crate::offline::autotune::{AxisFigures, CircleFigures};
use crate::offline::circle::CircularTest;
use crate::offline::identify::Findings;
use crate::offline::report::autotune::{self, Shown};
use crate::offline::tune::Tuned;
use crate::offline::tune::space::Choice;

/// All steps.
const STEPS: usize = 8;

/// A circle that was run.
pub(super) struct CircleTold {
    pub(super) figures: CircleFigures,
    pub(super) test: CircularTest,
}

impl Serialize for CircleTold {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.figures.serialize(serializer)
    }
}

/// A search with what it promises.
pub(super) struct TunedTold {
    pub(super) tuned: Tuned,
    pub(super) predicted_um: f64,
}

/// What is printed of the search.
#[derive(Serialize)]
struct Found<'a> {
    gains: &'a Choice,
    predicted_um: f64,
    phase_margin_deg: f64,
    gain_margin_db: Option<f64>,
    ms: f64,
    active_constraints: &'a [String],
    evaluations: usize,
    plants: usize,
}

impl Serialize for TunedTold {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Tuned { best, active, evaluations, cases, .. } = &self.tuned;
        let figures = &best.figures;
        Found {
            gains: &best.choice,
            predicted_um: self.predicted_um,
            phase_margin_deg: figures.phase_margin_deg,
            gain_margin_db: Some(figures.gain_margin_db).filter(|db| db.is_finite()),
            ms: figures.ms,
            active_constraints: active,
            evaluations: *evaluations,
            plants: *cases,
        }
        .serialize(serializer)
    }
}

/// How it all ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    /// The new gains are in the file.
    Written,
    /// The file is as it was.
    Kept,
}

/// All that is told.
#[derive(Serialize)]
pub(super) struct Told {
    machine: String,
    from: String,
    name: String,
    verdict: Verdict,
    /// Why the old gains were kept.
    reason: Option<String>,
    /// Steps that were begun, in order; the last is the one that ended it.
    steps: Vec<&'static str>,
    radius_mm: f64,
    feed_mm_per_min: f64,
    given: Choice,
    pub(super) before: Option<CircleTold>,
    pub(super) identified: Findings,
    /// Keys that nothing told.
    pub(super) kept_values: Vec<String>,
    pub(super) tuned: Option<TunedTold>,
    pub(super) reduced: Option<CircleFigures>,
    pub(super) after: Option<CircleTold>,
    /// The file that takes the result.
    file: PathBuf,
    pub(super) written: Option<PathBuf>,
    pub(super) old_file: Option<PathBuf>,
    pub(super) logs: Vec<PathBuf>,
    report: Option<PathBuf>,
    #[serde(rename = "is_incomplete")]
    pub(super) is_incomplete: bool,
}

impl Told {
    pub(super) fn new(setup: &Setup<'_>, file: &Path) -> Self {
        let Setup { machine, arguments, path, given, .. } = setup;
        eprintln!("machine {} of {}; the result goes into {}", machine.name, machine.source, file.display());
        eprintln!(
            "Ctrl-C ends it: axes that move come to rest along their path, and the file stays as it is"
        );
        Self {
            machine: machine.name.clone(),
            from: arguments.search.from.clone(),
            name: arguments.name.clone(),
            verdict: Verdict::Kept,
            reason: None,
            steps: Vec::new(),
            radius_mm: path.radius.as_mm(),
            feed_mm_per_min: path.feed.as_mm_per_min(),
            given: *given,
            before: None,
            identified: Findings::new(),
            kept_values: Vec::new(),
            tuned: None,
            reduced: None,
            after: None,
            file: file.to_owned(),
            written: None,
            old_file: None,
            logs: Vec::new(),
            report: None,
            is_incomplete: false,
        }
    }

    /// A step begins.
    pub(super) fn begin(&mut self, step: &'static str, what: &str) {
        self.steps.push(step);
        eprintln!("step {} of {STEPS}, {step}: {what}", self.steps.len());
    }

    /// The step that runs.
    pub(super) fn step(&self) -> &'static str {
        self.steps.last().copied().unwrap_or("start")
    }

    /// The steps are over.
    pub(super) fn end(&mut self, error: Option<anyhow::Error>) {
        match error {
            None => self.verdict = Verdict::Written,
            Some(error) => self.reason = Some(format!("{}: {error:#}", self.step())),
        }
    }

    /// How it all ended, in one sentence.
    pub(super) fn verdict_in_words(&self) -> String {
        match (&self.reason, &self.old_file) {
            (Some(reason), _) => {
                format!("the old gains are kept, {} is as it was: {reason}", self.file.display())
            }
            (None, Some(old)) => format!(
                "written: gain set {} of {}; the file as it was is {}",
                self.name,
                self.file.display(),
                old.display()
            ),
            (None, None) => format!("written: gain set {} of {}, a new file", self.name, self.file.display()),
        }
    }

    /// Where the gains of the set come from.
    pub(super) fn note(&self, date: &str, program: &str) -> String {
        let logs: Vec<String> = self.logs.iter().map(|log| log.display().to_string()).collect();
        let mut note = format!("quadrant autotune, {date}, {program}\nlogs {}", logs.join(", "));
        if let (Some(before), Some(after)) = (&self.before, &self.after) {
            let [old, new] = [before, after].map(|circle| view::circle_line(&circle.figures));
            note += &format!(
                "\non a circle of {} mm at {:.0} mm/min: {new}\nbefore, with the gains {}: {old}",
                self.radius_mm, self.feed_mm_per_min, self.from
            );
        }
        if let Some(TunedTold { tuned, predicted_um }) = &self.tuned {
            let figures = &tuned.best.figures;
            note += &format!(
                "\non the model {predicted_um:.2} um, phase margin {:.1} deg, Ms {:.2}, {} evaluations; held by {}",
                figures.phase_margin_deg,
                figures.ms,
                tuned.evaluations,
                if tuned.active.is_empty() { "nothing".to_owned() } else { tuned.active.join("; ") }
            );
        }
        note
    }

    /// Name, before and after of each figure that is known.
    fn rows(&self) -> Vec<[String; 3]> {
        let both = [self.before.as_ref(), self.after.as_ref()].map(|told| told.map(|told| &told.figures));
        let found = self.tuned.as_ref().map(|told| told.tuned.best.choice);
        let shown = |value: Option<f64>, decimals: usize| {
            value.map_or("none".to_owned(), |value| format!("{value:.decimals$}"))
        };
        let of_gains = |name: &str, decimals: usize, value: &dyn Fn(&Choice) -> f64| {
            let new = shown(found.as_ref().map(value), decimals);
            [name.to_owned(), shown(Some(value(&self.given)), decimals), new]
        };
        let of_circle = |name: String, value: &dyn Fn(&CircleFigures) -> Option<f64>| {
            let [before, after] = both.map(|figures| shown(figures.and_then(value), 2));
            [name, before, after]
        };
        let mut rows = vec![
            of_gains("V_p", 3, &|choice| choice.v_p),
            of_gains("V_i", 4, &|choice| choice.v_i),
            of_gains("K_p, 1/s", 3, &|choice| choice.kp_per_s),
            of_gains("friction feed-forward", 3, &|choice| choice.friction_feed_forward),
            of_gains("inertia feed-forward", 3, &|choice| choice.inertia_feed_forward),
        ];
        type OfAxis = fn(&AxisFigures) -> Option<f64>;
        let of_axis: [(&str, OfAxis); 5] = [
            ("protrusion at the motor encoder, um", |axis| Some(axis.protrusion_um)),
            ("farthest from the orbit at the motor encoder, um", |axis| Some(axis.deviation_um)),
            ("the same at the table, um", |axis| axis.table_deviation_um),
            ("largest current, A", |axis| Some(axis.current_a_max)),
            ("largest following error, mm", |axis| Some(axis.following_error_mm_max)),
        ];
        for (place, axis) in ["x", "y"].into_iter().enumerate() {
            for (name, value) in of_axis {
                rows.push(of_circle(format!("{axis}: {name}"), &|figures| value(&figures.axes[place])));
            }
        }
        rows.push(of_circle("radius decrease, um".to_owned(), &|figures| Some(figures.radius_decrease_um)));
        rows.push(of_circle("circular deviation G, um".to_owned(), &|figures| {
            Some(figures.circular_deviation_um)
        }));
        rows
    }

    /// For people.
    pub(super) fn text(&self) -> String {
        let report = self.report.as_ref().map(|page| format!("report  {}\n", page.display()));
        let table = self.before.as_ref().map(|_| view::before_and_after(&self.rows()) + "\n\n");
        format!("{}{}\n{}", table.unwrap_or_default(), self.verdict_in_words(), report.unwrap_or_default())
    }

    /// The page, if there is anything to show; a page that cannot be written is said, and changes no gains.
    pub(super) fn write_report(&mut self, folder: &Path) {
        let Some(before) = &self.before else { return };
        let shown = Shown {
            machine: &self.machine,
            verdict: &self.verdict_in_words(),
            is_written: self.verdict == Verdict::Written,
            steps: &self.steps,
            rows: &self.rows(),
            before: &before.test,
            after: self.after.as_ref().map(|after| &after.test),
            identified: &self.identified,
            kept_values: &self.kept_values,
            logs: &self.logs,
        };
        match autotune::write(folder, &shown) {
            Ok(page) => self.report = Some(page),
            Err(error) => {
                eprintln!("error: {error}");
                self.is_incomplete = true;
            }
        }
    }

    /// How the verb ends.
    pub(super) fn outcome(&self) -> Outcome {
        match self.verdict {
            Verdict::Kept => Outcome::NotDone,
            Verdict::Written if self.is_incomplete => Outcome::Incomplete,
            Verdict::Written => Outcome::Done,
        }
    }
}
