//! How often intervals contain the truth, over a hundred random machines; the table of `docs/identification.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use rayon::prelude::*;
use statrs::distribution::{Binomial, DiscreteCDF};

use crate::{identified, machines, runs, truths};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/identification.md");
const MARKS: [&str; 2] = ["<!-- coverage -->\n", "<!-- /coverage -->\n"];
/// Logs; each has two axes, and every axis is a machine of its own. All of them with `QUADRANT_FULL`, for the table.
const LOGS: u64 = 50;
const SOME_LOGS: u64 = 16;
/// Bounds of the share of intervals that contain the truth, %, by parameter: of one encoder alone they are too few. The
/// lower one holds for what is counted, the upper one for the chance behind it.
const BOUNDS_PERCENT: [f64; 2] = [90.0, 99.0];
/// What has a chance of the upper bound shows a number beyond ours once in so many times.
const ONCE_IN: f64 = 40.0;
/// Parameters that say nothing of each other; the others are the same measurement again, of one way or another unit.
const APART: [&str; 10] = [
    "breakaway",
    "constant_force",
    "current_loop",
    "dead_time",
    "fall_end",
    "fall_start",
    "moving_mass",
    "sliding",
    "stiffness",
    "viscous",
];

/// One parameter with one encoder.
#[derive(Default)]
struct Row {
    unknown: usize,
    /// Error and half of the interval: as shares of the truth, but for what may be zero.
    errors: Vec<f64>,
    halves: Vec<f64>,
    /// With the torque constant as it is, and as it is believed to be.
    inside: [usize; 2],
}

#[test]
#[ignore = "takes minutes: run it in release"]
fn intervals_contain_the_truth_as_often_as_they_say() {
    let mut rows: BTreeMap<(&str, &str), Row> = BTreeMap::new();
    // One after the other on each processor, then counted in order.
    let is_full = ["QUADRANT_FULL", "QUADRANT_WRITE"].iter().any(|name| std::env::var_os(name).is_some());
    let all: Vec<_> = (0..if is_full { LOGS } else { SOME_LOGS })
        .into_par_iter()
        .map(|seed| {
            let pair = machines::random(seed);
            let log = runs::log(&pair.truth, runs::ALL, seed);
            let percent = machines::TORQUE_CONSTANT_PERCENT;
            let found =
                pair.truth.axes.map(|axis, _| identified(&log, &pair.believed, axis, percent).findings);
            (seed, pair, found)
        })
        .collect();
    for (seed, pair, found) in &all {
        let encoder = if seed.is_multiple_of(2) { "0.1 um" } else { "1 um" };
        for axis in pair.truth.axes.axes() {
            let found = &found[axis];
            let [is, believed] = [&pair.truth, &pair.believed]
                .map(|one| one.axes[axis].plant.actuator.torque_constant_nm_per_a);
            for (name, truth) in truths(&pair.truth, axis) {
                let row = rows.entry((name, encoder)).or_default();
                let Some(estimate) = found[name].estimate() else {
                    row.unknown += 1;
                    continue;
                };
                let [low, high] = estimate.ci95;
                row.inside[1] += usize::from((low..=high).contains(&truth));
                let is_of_force = estimate.source.contains("torque constant");
                let (value, low, high) = if is_of_force {
                    let scale = 0.01 * machines::TORQUE_CONSTANT_PERCENT * estimate.value;
                    let half = |end: f64| ((end - estimate.value).powi(2) - scale * scale).max(0.0).sqrt();
                    let value = estimate.value * is / believed;
                    (value, value - half(low), value + half(high))
                } else {
                    (estimate.value, low, high)
                };
                let is_inside = (low..=high).contains(&truth);
                row.inside[0] += usize::from(is_inside);
                if !is_inside {
                    println!("log {seed}, axis {axis}: {name} {low} to {high}, truth {truth}");
                }
                let unit = if truth == 0.0 { 1.0 } else { truth };
                row.errors.push((value - truth) / unit);
                row.halves.push(0.5 * (high - low) / unit);
            }
        }
    }
    let table = rows.iter().map(line).collect::<String>();
    let page = fs::read_to_string(PAGE).expect("the page");
    let (before, rest) = page.split_once(MARKS[0]).expect("the first mark");
    let (written, after) = rest.split_once(MARKS[1]).expect("the second mark");
    let head = "| parameter | encoder | unknown | error, rms | half interval, median | truth inside | with K_t off |\n\
                |---|---|---|---|---|---|---|\n";
    let table = format!("{head}{table}");
    if std::env::var_os("QUADRANT_WRITE").is_some() {
        fs::write(PAGE, format!("{before}{}{table}{}{after}", MARKS[0], MARKS[1])).expect("written");
    } else if is_full {
        assert_eq!(written, table, "docs/identification.md; QUADRANT_WRITE=1 writes it");
    } else {
        println!("{table}");
    }
    let mut apart = [0, 0];
    let names: BTreeSet<&str> = rows.keys().map(|(name, _)| *name).collect();
    for name in names {
        let of: Vec<&Row> =
            rows.iter().filter(|((other, _), _)| *other == name).map(|(_, row)| row).collect();
        let known: usize = of.iter().map(|row| row.errors.len()).sum();
        let [itself, off] = [0, 1].map(|place| of.iter().map(|row| row.inside[place]).sum::<usize>());
        for (inside, how) in [(itself, "itself"), (off, "with its torque constant")] {
            let bounds = bounds_of(known);
            let is_within = (bounds[0]..=bounds[1]).contains(&(inside as f64));
            assert!(known == 0 || is_within, "{name}, {how}: {inside} of {known}, bounds {bounds:?}");
        }
        if APART.contains(&name) {
            apart[0] += itself;
            apart[1] += known;
        }
    }
    let [inside, known] = apart;
    let bounds = bounds_of(known);
    let is_within = (bounds[0]..=bounds[1]).contains(&(inside as f64));
    assert!(is_within, "all parameters: {inside} of {known}, bounds {bounds:?}");
}

/// How many of so many must be inside, and how many may be, as the binomial distribution has it: of one parameter of a
/// hundred machines all may, of all parameters together they may not.
fn bounds_of(count: usize) -> [f64; 2] {
    let [low, high] = BOUNDS_PERCENT.map(|percent| 0.01 * percent);
    let most = Binomial::new(high, count as u64).expect("a chance").inverse_cdf(1.0 - 1.0 / ONCE_IN);
    [low * count as f64, most as f64]
}

fn line(((name, encoder), row): (&(&str, &str), &Row)) -> String {
    let known = row.errors.len();
    if known == 0 {
        return format!("| {name} | {encoder} | {} | | | | |\n", row.unknown);
    }
    let rms = (row.errors.iter().map(|error| error * error).sum::<f64>() / known as f64).sqrt();
    let mut halves = row.halves.clone();
    halves.sort_by(f64::total_cmp);
    let half = halves[known / 2];
    let shown = |value: f64| match *name {
        "constant_force" => format!("{value:.2} N"),
        "dead_time" => format!("{value:.1} us"),
        _ => format!("{:.2} %", 100.0 * value),
    };
    let [itself, off] = row.inside;
    format!(
        "| {name} | {encoder} | {} | {} | {} | {itself} of {known} | {off} of {known} |\n",
        row.unknown,
        shown(rms),
        shown(half)
    )
}
