//! Laps of a run, and motions that come again in it.
//!
//! A lap need not be a whole number of rows: the lag is where setpoints come again best, between rows too.
//! Invariant: what was measured takes no part.

use super::Run;
use super::motions::motions;
use super::repeat::{REPEAT_MIN_S, Repeat, SAME_SHARE, What, span_of};

/// Shortest lap, s.
const LAP_MIN_S: f64 = 0.5;

/// A run with what its repeats are looked for by.
struct Laps<'r> {
    run: &'r Run,
    columns: Vec<&'r [f64]>,
    span_m: f64,
    /// Rows of [`LAP_MIN_S`], in which what was different fades, and of a stretch that is long enough.
    least: usize,
    fade: usize,
    repeat_min: usize,
}

impl<'r> Laps<'r> {
    /// Nothing of a run that is too short or stands.
    fn of(run: &'r Run, fade: usize) -> Option<Self> {
        let rows_in = |seconds: f64| (seconds / run.period_s) as usize;
        let laps = Self {
            run,
            columns: run.axes.values().map(|axis| axis.setpoint_m.as_slice()).collect(),
            span_m: span_of(run, 0..run.len()),
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
        Repeat { what: What::Run, runs: [index, index], shift, rows: [from + self.fade, to] }
    }
}

/// The first lag at which most setpoints of a run come again, with the longest stretch of rows for which they do.
pub(in crate::offline::gap) fn laps(index: usize, run: &Run, fade: usize) -> Option<Repeat> {
    let laps = Laps::of(run, fade)?;
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
pub(super) fn motions_again(index: usize, run: &Run, fade: usize) -> Option<Repeat> {
    let laps = Laps::of(run, fade)?;
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
pub(in crate::offline::gap) fn at(column: &[f64], row: f64) -> f64 {
    let low = row.floor() as usize;
    let share = row - low as f64;
    match (column.get(low), column.get(low + 1)) {
        (Some(a), Some(b)) => a + share * (b - a),
        (Some(a), None) => *a,
        (None, _) => f64::NAN,
    }
}
