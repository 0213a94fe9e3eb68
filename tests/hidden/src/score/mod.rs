//! What was found against what is there: the score table and who was taken for whom.
//!
//! An answer is a JSON file named as its case: verdict, effects (the likeliest first) with parameters, intervals,
//! confidence and alternatives, the share of the held-out gap that was closed, seconds.
//! Invariant: every share is printed with what it is a share of, and its 95 % interval by Wilson.

mod confusion;
mod table;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde_json::Value;

use crate::case::Truth;
use crate::plan::{Role, Severity};

pub use confusion::confusion;
pub use table::table;

/// Names that no log of an axis can tell apart; told as a class, or taken for each other, they are right.
const TWINS: [[&str; 2]; 2] =
    [["encoder-eccentricity", "pitch-error"], ["constant-force", "direction-asymmetry"]];
/// Most names of a class that still says something.
const CLASS_MAX: usize = 3;

/// An effect as it was found.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct FoundEffect {
    /// x or y.
    pub axis: String,
    /// Its name.
    pub name: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, Value>,
    /// 95 % intervals of those.
    pub interval: BTreeMap<String, Value>,
    /// Probability that it is this one, 0 to 1.
    pub confidence: Option<f64>,
    /// What it could be instead: names, or objects with a name.
    pub alternatives: Vec<Value>,
}

/// The gap, before and after.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Gap {
    /// Share of it that is closed on the held-out runs.
    pub heldout_closed_fraction: Option<f64>,
}

/// An answer to a case.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Answer {
    /// `named`, `class`, `unknown`, `nothing-missing`, `parameter-only`, `insufficient`; anything else is a failure.
    pub verdict: String,
    /// What was found, the likeliest first.
    pub effects: Vec<FoundEffect>,
    /// The gap.
    pub gap: Gap,
    /// How long it took.
    pub seconds: Option<f64>,
}

impl FoundEffect {
    /// Names of what it could be, its own first.
    fn class(&self) -> Vec<&str> {
        std::iter::once(self.name.as_str())
            .chain(
                self.alternatives
                    .iter()
                    .filter_map(|other| other.as_str().or_else(|| other.get("name").and_then(Value::as_str))),
            )
            .collect()
    }
}

impl Answer {
    /// Whether it is an answer at all.
    fn is_one(&self) -> bool {
        ["named", "class", "unknown", "nothing-missing", "parameter-only", "insufficient"]
            .contains(&self.verdict.as_str())
    }

    /// Whether something is named.
    fn has_name(&self) -> bool {
        ["named", "class"].contains(&self.verdict.as_str()) && !self.effects.is_empty()
    }

    /// What it says first: a name, or its verdict.
    fn says(&self) -> &str {
        if self.has_name() { &self.effects[0].name } else { &self.verdict }
    }
}

/// Whether a name is that of the truth, or of its twin.
fn is_same(name: &str, truth: &str) -> bool {
    name == truth || TWINS.iter().any(|twins| twins.contains(&name) && twins.contains(&truth))
}

/// A case with its answer.
pub struct Judged {
    /// The truth.
    pub truth: Truth,
    /// The answer.
    pub answer: Answer,
}

impl Judged {
    /// The first name is that of one of the true effects.
    fn is_exact(&self) -> bool {
        self.answer.has_name()
            && self.truth.effects.iter().any(|effect| is_same(self.answer.says(), &effect.name))
    }

    /// A true effect is in the class of the first one, and the class is small.
    fn is_in_class(&self) -> bool {
        let Some(first) = self.answer.effects.first().filter(|_| self.answer.has_name()) else {
            return false;
        };
        let class = first.class();
        class.len() <= CLASS_MAX
            && self.truth.effects.iter().any(|truth| class.iter().any(|name| is_same(name, &truth.name)))
    }

    /// Medium or large.
    fn is_plain_to_see(&self) -> bool {
        self.truth.severity.is_some_and(|severity| severity != Severity::Small)
    }

    fn is(&self, role: Role) -> bool {
        self.truth.role == role
    }

    fn has_plain_effect(&self) -> bool {
        self.is(Role::Single) && self.is_plain_to_see()
    }

    fn lacks_nothing(&self) -> bool {
        self.is(Role::Null) || self.is(Role::Decoy)
    }

    fn is_surely_misnamed(&self) -> bool {
        self.answer.verdict == "named" && !self.is_exact()
    }
}

/// What of some answers does not hold: a wrong name that is said for sure, any name where nothing is missing, an answer
/// that failed, and fewer right first names of plain single effects than this share of them.
pub fn faults(all: &[Judged], least_right: f64) -> Vec<String> {
    let fault = |judged: &Judged| {
        let (id, says) = (&judged.truth.id, judged.answer.says());
        if !judged.answer.is_one() {
            Some(format!("{id}: no answer"))
        } else if judged.lacks_nothing() && judged.answer.has_name() {
            Some(format!("{id}: {says} where nothing is missing"))
        } else if judged.is(Role::Single) && judged.is_surely_misnamed() {
            Some(format!("{id}: {says}, and sure of it"))
        } else {
            None
        }
    };
    let mut faults: Vec<String> = all.iter().filter_map(fault).collect();
    let plain: Vec<&Judged> = all.iter().filter(|judged| judged.has_plain_effect()).collect();
    let right = plain.iter().filter(|judged| judged.is_exact()).count();
    if (right as f64) < least_right * plain.len() as f64 {
        faults.push(format!("{right} of {} plain effects named, wanted {least_right}", plain.len()));
    }
    faults
}

/// All cases below a folder that have an answer in another.
pub fn judged(cases: &Path, results: &Path) -> Result<Vec<Judged>> {
    let mut all = Vec::new();
    let mut folders: Vec<_> = fs::read_dir(cases)
        .with_context(|| format!("cannot read {}", cases.display()))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join("truth.json").is_file())
        .collect();
    folders.sort();
    for folder in folders {
        let truth: Truth = read(&folder.join("truth.json"))?;
        let path = results.join(format!("{}.json", truth.id));
        let answer: Answer = if path.is_file() { read(&path)? } else { Answer::default() };
        all.push(Judged { truth, answer });
    }
    if all.is_empty() {
        bail!("no case with a truth.json below {}", cases.display());
    }
    Ok(all)
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("{} is not as it should be", path.display()))
}
