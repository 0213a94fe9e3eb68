//! The score table: shares with their intervals, errors of parameters, what the gap closed, how long it took.
//! Invariant: a score without a case is said to have none, and is no success.

use std::fmt::Write;

use serde_json::Value;

use super::{FoundEffect, Judged, is_same};
use crate::case::TrueEffect;
use crate::plan::{Role, Severity};

/// Bins of confidence for its calibration.
const BINS: usize = 10;

/// A share and its 95 % interval by Wilson.
fn wilson(hits: usize, count: usize) -> [f64; 3] {
    let (n, z) = (count as f64, 1.959_964);
    let share = hits as f64 / n;
    let middle = (share + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    [share, (middle - half).max(0.0), (middle + half).min(1.0)]
}

/// The table as text.
pub fn table(judged: &[Judged]) -> String {
    let mut text = String::from(
        "                                               share  95 % interval    cases  wanted\n",
    );
    let mut line = |name: &str, wanted: &str, of: Vec<bool>| {
        let hits = of.iter().filter(|is_hit| **is_hit).count();
        let row = if of.is_empty() {
            format!("{name:44}  no case                           {wanted}")
        } else {
            let [share, low, high] = wilson(hits, of.len()).map(|share| 100.0 * share);
            format!("{name:44} {share:6.1} %  {low:5.1} to {high:5.1}  {hits:>4}/{:<4} {wanted}", of.len())
        };
        writeln!(text, "{row}").expect("a string takes all text");
    };
    let shares = |cases: &dyn Fn(&Judged) -> bool, is_hit: &dyn Fn(&Judged) -> bool| -> Vec<bool> {
        judged.iter().filter(|case| cases(case)).map(is_hit).collect()
    };
    let single = |case: &Judged| case.is(Role::Single);
    let plain = |case: &Judged| case.has_plain_effect();
    let small = |case: &Judged| single(case) && case.truth.severity == Some(Severity::Small);
    let exact = |case: &Judged| case.is_exact();
    let class = |case: &Judged| case.is_in_class();
    line(
        "first name, medium and large, with scale",
        ">= 93",
        shares(&|c| plain(c) && c.truth.has_table, &exact),
    );
    line("  in a class of three at most", ">= 98", shares(&|c| plain(c) && c.truth.has_table, &class));
    line(
        "first name, medium and large, without scale",
        ">= 85",
        shares(&|c| plain(c) && !c.truth.has_table, &exact),
    );
    line("  in a class of three at most", ">= 95", shares(&|c| plain(c) && !c.truth.has_table, &class));
    line("first name, small", ">= 75", shares(&small, &exact));
    let right_axis = |case: &Judged| case.answer.effects[0].axis == case.truth.effects[0].axis;
    line("axis of a right name", "", shares(&|c| single(c) && c.is_exact(), &right_axis));
    let has_effect = |case: &Judged| case.is(Role::Single) || case.is(Role::Pair);
    line("wrong name, said for sure", "<= 2", shares(&has_effect, &|c| c.is_surely_misnamed()));
    let named = |case: &Judged| case.answer.has_name();
    line("any name where nothing is missing", "<= 1", shares(&|c| c.lacks_nothing(), &named));
    line("  without the decoys", "<= 1", shares(&|c| c.is(Role::Null), &named));
    let is_open = |case: &Judged| ["unknown", "insufficient"].contains(&case.answer.verdict.as_str());
    let strange = |case: &Judged| case.is(Role::Unknown) && case.is_plain_to_see();
    line("unknown effects that are called unknown", ">= 90", shares(&strange, &is_open));
    let is_unknown = |case: &Judged| case.answer.verdict == "unknown";
    line("called unknown and are", ">= 85", shares(&is_unknown, &|c| c.is(Role::Unknown)));
    let pair = |case: &Judged| case.is(Role::Pair);
    line("pairs, both right", ">= 80", shares(&pair, &|c| found(c) == 2));
    line("pairs, one right at least", ">= 98", shares(&pair, &|c| found(c) >= 1));
    line("pairs, one too many", "<= 3", shares(&pair, &|c| c.answer.effects.len() > 2));
    let all_found =
        judged.iter().filter(|c| has_effect(c)).flat_map(|c| c.truth.effects.iter().map(|e| is_found(c, e)));
    line("effects that are found", ">= 90", all_found.collect());
    let said = judged.iter().filter(|c| c.answer.has_name()).flat_map(|c| {
        let is_there = |name: &str| c.truth.effects.iter().any(|effect| is_same(name, &effect.name));
        c.answer.effects.iter().map(move |effect| is_there(&effect.name))
    });
    line("names that are right", ">= 97", said.collect());
    let (errors, covered) = parameters(judged);
    line("parameters within their 95 % interval", "90 to 98", covered);
    line("no answer or a failure", "0", shares(&|_| true, &|c| !c.answer.is_one()));
    text.push('\n');
    quantiles(&mut text, "error of parameters, %", "5 and 15", errors, [0.5, 0.9]);
    let gaps = judged.iter().filter(|c| plain(c)).filter_map(|c| c.answer.gap.heldout_closed_fraction);
    quantiles(&mut text, "share of the held-out gap closed", "0.95 and 0.85", gaps.collect(), [0.5, 0.1]);
    let seconds = judged.iter().filter_map(|case| case.answer.seconds);
    quantiles(&mut text, "seconds", "30", seconds.collect(), [0.5, 0.9]);
    let error = calibration(judged);
    let error = error.map_or_else(|| "no case".to_owned(), |error| format!("{error:.3}"));
    writeln!(text, "{:44} {error}  wanted 0.05 at most", "calibration error of the confidence")
        .expect("a string takes all text");
    text
}

fn is_found(case: &Judged, effect: &TrueEffect) -> bool {
    case.answer.has_name() && case.answer.effects.iter().any(|found| is_same(&found.name, &effect.name))
}

fn found(case: &Judged) -> usize {
    case.truth.effects.iter().filter(|effect| is_found(case, effect)).count()
}

/// Relative errors of the parameters of right names in per cent, and whether their intervals hold them.
fn parameters(judged: &[Judged]) -> (Vec<f64>, Vec<bool>) {
    let (mut errors, mut covered) = (Vec::new(), Vec::new());
    for case in judged.iter().filter(|case| case.answer.has_name()) {
        for truth in &case.truth.effects {
            let is_it = |found: &&FoundEffect| found.name == truth.name && found.axis == truth.axis;
            let Some(found) = case.answer.effects.iter().find(is_it) else { continue };
            for (key, value) in &truth.parameters {
                let Some(value) = value.as_f64() else { continue };
                if let Some(estimate) = found.parameters.get(key).and_then(Value::as_f64) {
                    errors.push(100.0 * (estimate / value - 1.0).abs());
                }
                let ends = found.interval.get(key).and_then(Value::as_array);
                let ends: Option<Vec<f64>> = ends.and_then(|ends| ends.iter().map(Value::as_f64).collect());
                if let Some([low, high]) = ends.as_deref() {
                    covered.push((*low..=*high).contains(&value));
                }
            }
        }
    }
    (errors, covered)
}

/// Mean distance between stated confidence and share of right names, over bins of confidence.
fn calibration(judged: &[Judged]) -> Option<f64> {
    let mut bins = [(0.0, 0.0, 0.0); BINS];
    for case in judged.iter().filter(|case| case.answer.has_name()) {
        let Some(confidence) = case.answer.effects[0].confidence else { continue };
        let bin = &mut bins[((confidence * BINS as f64) as usize).min(BINS - 1)];
        bin.0 += confidence;
        bin.1 += f64::from(u8::from(case.is_exact()));
        bin.2 += 1.0;
    }
    let count: f64 = bins.iter().map(|bin| bin.2).sum();
    (count > 0.0).then(|| bins.iter().map(|(stated, right, _)| (stated - right).abs()).sum::<f64>() / count)
}

fn quantiles(text: &mut String, name: &str, wanted: &str, mut values: Vec<f64>, at: [f64; 2]) {
    values.sort_by(f64::total_cmp);
    let quantile = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    let row = if values.is_empty() {
        format!("{name:44} no value")
    } else {
        let [first, second] = at;
        let percent = 100.0 * second;
        format!(
            "{name:44} median {:.3}, p{percent:.0} {:.3} of {}  wanted {wanted}",
            quantile(first),
            quantile(second),
            values.len()
        )
    };
    writeln!(text, "{row}").expect("a string takes all text");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_hundred_without_a_fault_prove_one_and_a_quarter_per_cent() {
        let [share, low, high] = wilson(0, 300);
        assert!(share == 0.0 && low < 1e-12, "{share}, from {low} on");
        assert!((high - 0.01264).abs() < 1e-4, "upper end {high}");
        let [_, low, high] = wilson(9, 10);
        assert!((low - 0.596).abs() < 1e-3 && (high - 0.982).abs() < 1e-3, "{low} to {high}");
    }
}
