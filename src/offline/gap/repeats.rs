//! Where a command comes again: in the laps of a run, and in runs of the same command.
//!
//! A lap need not be a whole number of rows. Where a run has none, motions between rests may come again in it, and where nothing of it does,
//! each of its motions may have laps, or come again beside others in another run. Where nothing comes again at its place, it may
//! elsewhere: what lies along the way is noise then. Where nothing goes on for long enough, what hardly faded tells more than nothing.
//! Invariant: what was measured takes no part.

use std::collections::BTreeSet;
use std::ops::Range;

use super::motions::{motions, part_of};
use super::runs::{Run, span};
use crate::base::axis::AxisId;

/// Shortest lap, s.
const LAP_MIN_S: f64 = 0.5;
/// Two passes of a command are the same within this share of its span.
const SAME_SHARE: f64 = 2e-4;
/// What was different before a repeat fades for so long, s, or at least for so long where nothing repeats otherwise.
const FADES_S: [f64; 2] = [1.0, 0.3];
/// And it must then go on for as long to tell the noise, s.
const REPEAT_MIN_S: f64 = 0.5;
/// Rows by which two motions may begin apart.
const ROWS_APART: usize = 2;
/// Where a run goes on for more than this share of it after its last repeat, that is no run-out.
const RUN_OUT_SHARE: f64 = 0.2;

/// Rows of a run that were commanded like rows of it, or of another run, before: `later = earlier + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeat {
    /// What comes again.
    pub what: What,
    /// Index of the run of the earlier pass, and of the later.
    pub runs: [usize; 2],
    /// Distance in rows; not whole for most laps.
    pub shift: f64,
    /// First and last row of the earlier pass that has a later one.
    pub rows: [usize; 2],
}

/// What comes again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A run, or its laps or motions.
    Run,
    /// A motion of a run in another.
    Motion,
    /// What one axis does, as circles the other way around are the same for one of two, whatever the others do.
    Axis(AxisId),
    /// The opposite of it: what is the same both ways counts as noise then.
    Opposite(AxisId),
}

impl Repeat {
    /// Whether it says anything of an axis.
    pub(super) fn is_of(&self, id: AxisId) -> bool {
        match self.what {
            What::Run | What::Motion => true,
            What::Axis(of) | What::Opposite(of) => of == id,
        }
    }

    /// What the later pass is multiplied with to be as the earlier.
    pub(super) fn sign(&self) -> f64 {
        if matches!(self.what, What::Opposite(_)) { -1.0 } else { 1.0 }
    }
}

/// The repeats in and between runs; where nothing comes again for all axes together, those of each by itself.
pub fn repeats(runs: &[Run]) -> Vec<Repeat> {
    let found = by_first_way(runs, &[Place::Same, Place::Other]);
    if !found.is_empty() {
        return found;
    }
    let ids: BTreeSet<AxisId> = runs.iter().flat_map(|run| run.axes.keys().copied()).collect();
    let of = |id: AxisId| {
        let alone = |run: &Run| {
            let mut alone = run.clone();
            alone.axes.retain(|other, _| *other == id);
            alone
        };
        let alone: Vec<Run> = runs.iter().map(alone).collect();
        let as_what = |what: What, places: &[Place]| -> Vec<Repeat> {
            by_first_way(&alone, places).into_iter().map(|repeat| Repeat { what, ..repeat }).collect()
        };
        let found = as_what(What::Axis(id), &[Place::Same, Place::Other]);
        if found.is_empty() { as_what(What::Opposite(id), &[Place::Opposite]) } else { found }
    };
    ids.into_iter().flat_map(of).collect()
}

/// The repeats by the first way on which there are any.
fn by_first_way(runs: &[Run], places: &[Place]) -> Vec<Repeat> {
    let of_fade = |fade_s: &f64| {
        let fade_s = *fade_s;
        places.iter().map(move |place| Way { fade_s, place: *place })
    };
    let ways = FADES_S.iter().flat_map(of_fade);
    ways.map(|way| way.repeats(runs)).find(|found| !found.is_empty()).unwrap_or_default()
}

/// Where a command comes again.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Same,
    Other,
    /// The other way, wherever.
    Opposite,
}

/// A way to look for repeats.
#[derive(Clone, Copy)]
struct Way {
    fade_s: f64,
    place: Place,
}

impl Way {
    fn repeats(self, runs: &[Run]) -> Vec<Repeat> {
        let mut found = Vec::new();
        for (index, run) in runs.iter().enumerate() {
            if self.place == Place::Same {
                found.extend(self.laps(index, run).or_else(|| self.motions_again(index, run)));
            }
            found.extend(self.again(runs, index));
        }
        let is_alone = |index: &usize| found.iter().all(|repeat: &Repeat| !repeat.runs.contains(index));
        let alone: Vec<usize> = (0..runs.len()).filter(is_alone).collect();
        found.extend(self.motions_elsewhere(runs, &alone));
        found
    }

    fn rows(self, run: &Run) -> usize {
        (self.fade_s / run.period_s) as usize
    }

    /// The repeats of a run in those after it.
    fn again(self, runs: &[Run], index: usize) -> impl Iterator<Item = Repeat> {
        let run = &runs[index];
        runs.iter()
            .enumerate()
            .skip(index + 1)
            .filter(move |(_, twin)| self.is_same_command(run, twin))
            .filter_map(move |(other, twin)| {
                let rows = [self.rows(run), run.len().min(twin.len()) - 1];
                (rows[1] > rows[0]).then_some(Repeat {
                    what: What::Run,
                    runs: [index, other],
                    shift: 0.0,
                    rows,
                })
            })
    }

    fn is_same_command(self, run: &Run, twin: &Run) -> bool {
        let rows = run.len().min(twin.len());
        run.len().abs_diff(twin.len()) * 50 < rows && self.is_same(run, 0..rows, twin, 0)
    }

    /// Whether rows of a run were commanded in another from a row on.
    fn is_same(self, run: &Run, rows: Range<usize>, twin: &Run, from: usize) -> bool {
        let most_m = SAME_SHARE * span_of(run, rows.clone());
        from + rows.len() <= twin.len()
            && run.axes.iter().all(|(id, axis)| {
                twin.axes.get(id).is_some_and(|other| {
                    let own = &axis.setpoint_m[rows.clone()];
                    let other = &other.setpoint_m[from..from + rows.len()];
                    let sign = if self.place == Place::Opposite { -1.0 } else { 1.0 };
                    let apart_m = if self.place == Place::Same { 0.0 } else { own[0] - sign * other[0] };
                    own.iter().zip(other).all(|(own, other)| (own - sign * other - apart_m).abs() <= most_m)
                })
            })
    }

    /// The laps of each motion of runs of which nothing else comes again, and motions that come again in another run, of which one is such.
    fn motions_elsewhere(self, runs: &[Run], alone: &[usize]) -> Vec<Repeat> {
        let mut found = Vec::new();
        let mut passed: Vec<(usize, Range<usize>)> = Vec::new();
        for (index, run) in runs.iter().enumerate() {
            for motion in motions(run) {
                if self.place == Place::Same && alone.contains(&index) {
                    let laps = self.laps(index, &part_of(run, &motion, String::new()));
                    found.extend(laps.map(|laps| Repeat {
                        what: What::Motion,
                        rows: laps.rows.map(|row| row + motion.start),
                        ..laps
                    }));
                }
                let earlier =
                    passed.iter().rev().filter(|(other, _)| alone.contains(other) || alone.contains(&index));
                let mut earlier = earlier.filter(|(_, rows)| rows.len().abs_diff(motion.len()) <= ROWS_APART);
                found.extend(earlier.find_map(|(other, rows)| {
                    let earlier = &runs[*other];
                    let rows = rows.start..rows.end.min(rows.start + motion.len());
                    let first = motion.start.saturating_sub(ROWS_APART)..=motion.start + ROWS_APART;
                    let first =
                        first.into_iter().find(|first| self.is_same(earlier, rows.clone(), run, *first))?;
                    let least = self.rows(run) + (REPEAT_MIN_S / run.period_s) as usize;
                    (rows.len() >= least).then_some(Repeat {
                        what: What::Motion,
                        runs: [*other, index],
                        shift: first as f64 - rows.start as f64,
                        rows: [rows.start + self.rows(run), rows.end],
                    })
                }));
                passed.push((index, motion));
            }
        }
        found
    }
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
    repeats.iter().filter(|repeat| repeat.what == What::Run).filter_map(of).min().unwrap_or(rows).min(rows)
}

fn span_of(run: &Run, rows: Range<usize>) -> f64 {
    run.axes.values().map(|axis| span(&axis.setpoint_m[rows.clone()])).fold(0.0, f64::max)
}

/// Whether a run is one of laps.
pub(super) fn repeats_itself(run: &Run) -> bool {
    Way { fade_s: FADES_S[0], place: Place::Same }.laps(0, run).is_some()
}

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

impl Way {
    /// The first lag at which most setpoints of a run come again, with the longest stretch of rows for which they do.
    fn laps(self, index: usize, run: &Run) -> Option<Repeat> {
        let laps = Laps::of(run, self.rows(run))?;
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
    fn motions_again(self, index: usize, run: &Run) -> Option<Repeat> {
        let laps = Laps::of(run, self.rows(run))?;
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
        let opposite = repeats(&[here, other]);
        assert_eq!(opposite[0].what, What::Opposite(AxisId::X), "{opposite:?}");
        assert!(of(&[motion(0.0, 0.02), motion(0.1, 0.03)]).is_empty());
    }

    const PERIOD_S: f64 = 5e-4;

    /// Circles of both axes one after the other, each of so many laps of so many rows, with rests before, between and behind; the sign tells
    /// the way around.
    fn circles(all: &[(f64, f64)]) -> Run {
        let (mut x_m, mut y_m) = (vec![0.0; 800], vec![0.0; 800]);
        for (laps, lap) in all {
            for row in 1..=(laps * lap.abs()) as usize {
                let (sin, cos) = (std::f64::consts::TAU * row as f64 / lap).sin_cos();
                x_m.push(0.02 * (1.0 - cos));
                y_m.push(0.02 * sin);
            }
            // Back to where it began, slowly.
            let from = [x_m[x_m.len() - 1], y_m[y_m.len() - 1]];
            for row in (0..100).rev() {
                x_m.push(from[0] * f64::from(row) / 100.0);
                y_m.push(from[1] * f64::from(row) / 100.0);
            }
            x_m.extend([0.0; 1_000]);
            y_m.extend([0.0; 1_000]);
        }
        Run::of_setpoints(PERIOD_S, [(AxisId::X, x_m), (AxisId::Y, y_m)])
    }

    #[test]
    fn a_motion_comes_again_beside_others_in_another_run() {
        let runs = [circles(&[(1.2, 4_000.0), (1.2, 5_000.0)]), circles(&[(1.2, 6_000.0), (1.2, 4_000.0)])];
        let [found] = repeats(&runs)[..] else { panic!("one motion: {:?}", repeats(&runs)) };
        assert_eq!((found.what, found.runs), (What::Motion, [0, 1]));
        assert_eq!(found.shift, 7_200.0 + 100.0 + 1_000.0);
        // Neither the runs as a whole nor what judges them are the same for that.
        assert_eq!(
            [0, 1].map(|run| first_pass(run, runs[run].len(), &[found])),
            [0, 1].map(|run| runs[run].len())
        );
    }

    #[test]
    fn a_motion_beside_others_has_laps() {
        let found = repeats(&[circles(&[(2.0, 4_000.0), (1.0, 5_000.0), (1.0, 6_000.0)])]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].shift == 4_000.0 && found[0].rows[0] >= 800 + 1_999 && found[0].rows[1] <= 4_900,
            "{found:?}"
        );
    }

    #[test]
    fn circles_the_other_way_around_are_the_same_for_one_axis_and_the_opposite_for_the_other() {
        let found = repeats(&[circles(&[(1.0, 6_000.0)]), circles(&[(1.0, -6_000.0)])]);
        let what: Vec<What> = found.iter().map(|repeat| repeat.what).collect();
        assert_eq!(what, [What::Axis(AxisId::X), What::Opposite(AxisId::Y)]);
        assert!(found[0].is_of(AxisId::X) && !found[0].is_of(AxisId::Y));
        assert_eq!([0, 1].map(|place| found[place].sign()), [1.0, -1.0]);
    }

    #[test]
    fn a_command_that_an_earlier_run_had_has_no_first_pass() {
        let repeat =
            |runs: [usize; 2], shift: f64, rows: [usize; 2]| Repeat { what: What::Run, runs, shift, rows };
        let repeats = [repeat([0, 0], 100.0, [0, 900]), repeat([0, 2], 0.0, [0, 1_000])];
        assert_eq!([0, 1, 2].map(|run| first_pass(run, 1_000, &repeats)), [100, 1_000, 0]);
    }
}
