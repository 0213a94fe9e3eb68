//! Where a command comes again: in the laps of a run, and in runs of the same command.
//!
//! A lap need not be a whole number of rows. Where a run has none, motions between rests may come again in it. Where nothing comes again at
//! its place, it may elsewhere: what lies along the way is noise then.
//! Invariant: what was measured takes no part.

use super::motions::motions;
use super::runs::{Run, span};

/// Shortest lap, s.
const LAP_MIN_S: f64 = 0.5;
/// Two passes of a command are the same within this share of its span.
const SAME_SHARE: f64 = 2e-4;
/// What was different before a repeat fades for so long, s, and it must then go on for so long to tell the noise.
const FADE_S: f64 = 1.0;
const REPEAT_MIN_S: f64 = 0.5;
/// Where a run goes on for more than this share of it after its last repeat, that is no run-out.
const RUN_OUT_SHARE: f64 = 0.2;

/// Rows of a run that were commanded like rows of it, or of another run, before: `later = earlier + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeat {
    /// Index of the run of the earlier pass, and of the later.
    pub runs: [usize; 2],
    /// Distance in rows; not whole for most laps.
    pub shift: f64,
    /// First and last row of the earlier pass that has a later one.
    pub rows: [usize; 2],
}

/// The repeats in and between runs.
pub fn repeats(runs: &[Run]) -> Vec<Repeat> {
    let mut found = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        found.extend(laps(index, run).or_else(|| motions_again(index, run)));
        found.extend(again(runs, index, |_| 0.0));
    }
    if found.is_empty() {
        found.extend((0..runs.len()).flat_map(|index| again(runs, index, |setpoint_m| setpoint_m[0])));
    }
    found
}

/// The repeats of a run in those after it, by setpoints from a place of each.
fn again(runs: &[Run], index: usize, from_m: fn(&[f64]) -> f64) -> impl Iterator<Item = Repeat> {
    let run = &runs[index];
    runs.iter()
        .enumerate()
        .skip(index + 1)
        .filter(move |(_, twin)| is_same_command(run, twin, from_m))
        .filter_map(move |(other, twin)| {
            let rows = [(FADE_S / run.period_s) as usize, run.len().min(twin.len()) - 1];
            (rows[1] > rows[0]).then_some(Repeat { runs: [index, other], shift: 0.0, rows })
        })
}

/// How many rows a run has until its command only repeats: its first lap with the start of the second; none where it is that of a
/// run before it.
pub fn first_pass(run: usize, rows: usize, repeats: &[Repeat]) -> usize {
    let of = |repeat: &Repeat| match repeat.runs {
        [first, second] if first < run && second == run => Some(0),
        [first, second] if first == run && second == run => {
            let shift = repeat.shift.ceil() as usize;
            let is_over = repeat.rows[1] + shift >= ((1.0 - RUN_OUT_SHARE) * rows as f64) as usize;
            is_over.then_some(repeat.rows[0] + shift)
        }
        _ => None,
    };
    repeats.iter().filter_map(of).min().unwrap_or(rows).min(rows)
}

fn is_same_command(run: &Run, twin: &Run, from_m: fn(&[f64]) -> f64) -> bool {
    let rows = run.len().min(twin.len());
    let is_long = run.len().abs_diff(twin.len()) * 50 < rows;
    let span_m = span_m(run);
    is_long
        && run.axes.iter().all(|(id, axis)| {
            twin.axes.get(id).is_some_and(|other| {
                let [own, other] = [&axis.setpoint_m, &other.setpoint_m];
                let apart_m = from_m(own) - from_m(other);
                (0..rows).all(|row| (own[row] - other[row] - apart_m).abs() <= SAME_SHARE * span_m)
            })
        })
}

fn span_m(run: &Run) -> f64 {
    run.axes.values().map(|axis| span(&axis.setpoint_m)).fold(0.0, f64::max)
}

/// Whether a run is one of laps.
pub(super) fn repeats_itself(run: &Run) -> bool {
    laps(0, run).is_some()
}

/// A run with what its repeats are looked for by.
struct Laps<'r> {
    run: &'r Run,
    columns: Vec<&'r [f64]>,
    span_m: f64,
    /// Rows of [`LAP_MIN_S`], of [`FADE_S`], and of a stretch that is long enough.
    least: usize,
    fade: usize,
    repeat_min: usize,
}

impl<'r> Laps<'r> {
    /// Nothing of a run that is too short or stands.
    fn of(run: &'r Run) -> Option<Self> {
        let rows_in = |seconds: f64| (seconds / run.period_s) as usize;
        let fade = rows_in(FADE_S);
        let laps = Self {
            run,
            columns: run.axes.values().map(|axis| axis.setpoint_m.as_slice()).collect(),
            span_m: span_m(run),
            least: rows_in(LAP_MIN_S),
            fade,
            repeat_min: fade + rows_in(REPEAT_MIN_S),
        };
        (run.len() > laps.least + laps.repeat_min && laps.span_m > 0.0).then_some(laps)
    }

    /// How far a setpoint is from that so many rows later.
    fn off(&self, row: usize, shift: f64) -> f64 {
        let off = |column: &&[f64]| (at(column, row as f64 + shift) - column[row]).abs();
        self.columns.iter().map(off).fold(0.0, f64::max)
    }

    /// The longest stretch of rows that come again so many rows later, if it is long enough and anything moves in it.
    fn stretch(&self, shift: f64) -> Option<[usize; 2]> {
        let rows = self.run.len() - shift.ceil() as usize;
        let [from, to] = longest(rows, |row| self.off(row, shift) <= SAME_SHARE * self.span_m)?;
        let moves = |column: &&[f64]| {
            let part = &column[from..to];
            part.iter().any(|value| (value - part[0]).abs() > 0.01 * self.span_m)
        };
        (to - from >= self.repeat_min && self.columns.iter().any(moves)).then_some([from, to])
    }

    fn repeat(&self, index: usize, shift: f64, [from, to]: [usize; 2]) -> Repeat {
        Repeat { runs: [index, index], shift, rows: [from + self.fade, to] }
    }
}

/// The first lag at which most setpoints of a run come again, with the longest stretch of rows for which they do.
fn laps(index: usize, run: &Run) -> Option<Repeat> {
    let laps = Laps::of(run)?;
    let rows = run.len();
    // Where setpoints come again, coarsely; then how well, and for how long.
    let probes = |lag: usize| -> f64 {
        let last = rows - lag;
        let count = 24.min(last);
        let from = |probe: usize| (probe * last) / count;
        let mut offs: Vec<f64> = (0..count).map(|probe| laps.off(from(probe), lag as f64)).collect();
        offs.sort_by(f64::total_cmp);
        // Most of the probes: run-in and run-out do not repeat.
        offs[(count * 6) / 10]
    };
    let step = 4;
    let lags: Vec<(usize, f64)> =
        (laps.least..rows - laps.repeat_min).step_by(step).map(|lag| (lag, probes(lag))).collect();
    let is_low = |place: usize| {
        let here = lags[place].1;
        here < 0.01 * laps.span_m
            && (place == 0 || lags[place - 1].1 >= here)
            && (place + 1 == lags.len() || lags[place + 1].1 >= here)
    };
    (0..lags.len()).filter(|place| is_low(*place)).find_map(|place| {
        let shift = refined(lags[place].0 as f64, step as f64, |shift| {
            let last = (rows as f64 - shift) as usize;
            let mut offs: Vec<f64> =
                (0..last).step_by((last / 200).max(1)).map(|row| laps.off(row, shift)).collect();
            offs.sort_by(f64::total_cmp);
            offs[(offs.len() * 6) / 10]
        });
        Some(laps.repeat(index, shift, laps.stretch(shift)?))
    })
}

/// Motions that come again somewhere in a run: the longest stretch of them.
fn motions_again(index: usize, run: &Run) -> Option<Repeat> {
    let laps = Laps::of(run)?;
    let motions = motions(run);
    let mut shifts: Vec<usize> = Vec::new();
    for (place, one) in motions.iter().enumerate() {
        let later = motions[place + 1..].iter().map(|other| other.start - one.start);
        // A row more or less is left to the stretch.
        shifts.extend(later.filter(|shift| *shift >= laps.least));
    }
    shifts.sort_unstable();
    shifts.dedup();
    let found = shifts.into_iter().filter(|shift| run.len() > shift + laps.repeat_min);
    let found = found.filter_map(|shift| Some((shift as f64, laps.stretch(shift as f64)?)));
    // Of equally long ones the first.
    let (shift, stretch) = found.fold(None, |best: Option<(f64, [usize; 2])>, (shift, [from, to])| {
        let length = |[from, to]: [usize; 2]| to - from;
        let is_longer = best.is_none_or(|(_, other)| to - from > length(other));
        if is_longer { Some((shift, [from, to])) } else { best }
    })?;
    Some(laps.repeat(index, shift, stretch))
}

/// The lag near `from` at which `off` is least, by golden section.
fn refined(from: f64, reach: f64, off: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (from - reach, from + reach);
    let ratio = 0.618_033_988_749_894_9;
    while high - low > 1e-4 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if off(a) < off(b) { high = b } else { low = a }
    }
    let lag = 0.5 * (low + high);
    // A lap of whole rows is one of whole rows.
    if (lag - lag.round()).abs() < 2e-3 && off(lag.round()) <= off(lag) * 1.01 { lag.round() } else { lag }
}

fn longest(rows: usize, is_same: impl Fn(usize) -> bool) -> Option<[usize; 2]> {
    let (mut best, mut from): (Option<[usize; 2]>, Option<usize>) = (None, None);
    for row in 0..=rows {
        let same = row < rows && is_same(row);
        match (same, from) {
            (true, None) => from = Some(row),
            (false, Some(begin)) => {
                if best.is_none_or(|[low, high]| row - begin > high - low) {
                    best = Some([begin, row]);
                }
                from = None;
            }
            (true, Some(_)) | (false, None) => {}
        }
    }
    best
}

/// A column between its rows.
pub(super) fn at(column: &[f64], row: f64) -> f64 {
    let low = row.floor() as usize;
    let share = row - low as f64;
    match (column.get(low), column.get(low + 1)) {
        (Some(a), Some(b)) => a + share * (b - a),
        (Some(a), None) => *a,
        (None, _) => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;

    /// A motion of an axis from a place.
    fn motion(from_m: f64, way_m: f64) -> Run {
        let rows = 6_000_usize;
        let at = |row: usize| from_m + way_m * (row.saturating_sub(1_000) as f64 / 4_000.0).min(1.0);
        Run::of_setpoints(5e-4, [(AxisId::X, (0..rows).map(at).collect())])
    }

    #[test]
    fn a_motion_comes_again_elsewhere_where_nothing_comes_again_at_its_place() {
        let [here, there, other] = [motion(0.0, 0.02), motion(0.1, 0.02), motion(0.1, -0.02)];
        let of = |runs: &[Run]| repeats(runs).iter().map(|repeat| repeat.runs).collect::<Vec<_>>();
        assert_eq!(of(&[here.clone(), there.clone(), other.clone()]), [[0, 1]]);
        assert_eq!(of(&[here.clone(), there, here.clone()]), [[0, 2]], "it does at its place");
        assert!(of(&[here, other]).is_empty());
    }

    #[test]
    fn a_command_that_an_earlier_run_had_has_no_first_pass() {
        let repeat = |runs: [usize; 2], shift: f64, rows: [usize; 2]| Repeat { runs, shift, rows };
        let repeats = [repeat([0, 0], 100.0, [0, 900]), repeat([0, 2], 0.0, [0, 1_000])];
        assert_eq!([0, 1, 2].map(|run| first_pass(run, 1_000, &repeats)), [100, 1_000, 0]);
    }
}
