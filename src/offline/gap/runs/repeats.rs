//! Where a command comes again: in the `laps` of a run, and in runs of the same command.
//!
//! A lap need not be a whole number of rows. Where a run has none, motions between rests may come again in it, and where nothing of it does,
//! each of its motions may have laps, or come again beside others in another run. Of a run that nothing tells how loud it is, as nothing comes
//! again at its place or is as fast, the same from another place does: what lies along the way is noise then; or what hardly
//! faded, one axis alone, or what it does the other way around.
//! Invariant: what was measured takes no part.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Run;
use super::laps::{laps, motions_again};
use super::motions::{STILL_M, motions, part_of};
use super::repeat::{FADE_S, REPEAT_MIN_S, Repeat, SAME_SHARE, What, span_of};
use crate::base::axis::AxisId;
use crate::offline::median::median;

/// What was different before a repeat fades for so long, s. Two motions from rest differ by how each was wound up there, and by hundredths
/// of a micrometre after the second; a first lap and a second by all of the start.
const FADES_S: [f64; 2] = [FADE_S, 0.6];
/// What comes again within a minute tells noise; what is later differs by what grows over a session too, so that it tells of runs of which
/// nothing else does. s.
const APART_S: [f64; 2] = [60.0, f64::INFINITY];
/// Rows by which two motions may begin apart.
const ROWS_APART: usize = 2;
/// What comes again tells of a run that is faster or slower by no more than so many times: a circle of one axis has all speeds below its
/// feed, and what comes again elsewhere or the other way around is not only noise.
const AS_FAST: f64 = 8.0;

/// The repeats in and between runs: of all axes together, and of runs that nothing tells how loud they are of each axis by itself.
pub fn repeats(runs: &[Run]) -> Vec<Repeat> {
    let mut found = Vec::new();
    look_on(runs, &mut found, &[Place::Same, Place::Other], |_, repeat| repeat);
    let ids: BTreeSet<AxisId> = runs.iter().flat_map(|run| run.axes.keys().copied()).collect();
    let of_axis = |id: AxisId| {
        let alone: Vec<Run> = runs.iter().map(|run| run.of_axis(id)).collect();
        let mut own = found.clone();
        look_on(&alone, &mut own, &[Place::Same, Place::Other, Place::Opposite], |place, repeat| {
            let what = if place == Place::Opposite { What::Opposite(id) } else { What::Axis(id) };
            Repeat { what, ..repeat }
        });
        own.split_off(found.len())
    };
    let of_axes: Vec<Repeat> = ids.into_iter().flat_map(of_axis).collect();
    found.extend(of_axes);
    found
}

/// Adds the repeats of runs that nothing tells how loud they are, way by way while there are any.
fn look_on(
    runs: &[Run],
    found: &mut Vec<Repeat>,
    places: &[Place],
    as_found: impl Fn(Place, Repeat) -> Repeat,
) {
    let speeds: Vec<f64> = runs.iter().map(|run| speed(run, 0..run.len())).collect();
    for way in Way::all(places) {
        let asked = untold(runs, &speeds, found);
        if asked.is_empty() {
            return;
        }
        found.extend(way.repeats(runs, &asked).into_iter().map(|repeat| as_found(way.place, repeat)));
    }
}

/// Runs that no repeat tells how loud they are: nothing of them comes again, nor anything that is about as fast.
fn untold(runs: &[Run], speeds: &[f64], found: &[Repeat]) -> Vec<usize> {
    let fast = |repeat: &Repeat| speed(&runs[repeat.runs[0]], repeat.rows[0]..repeat.rows[1]);
    let told: Vec<f64> = found.iter().map(fast).collect();
    let is_untold = |index: &usize| {
        let own = speeds[*index];
        let is_as_fast = |other: &f64| (1.0 / AS_FAST..=AS_FAST).contains(&(other / own));
        own > 0.0 && !told.iter().any(is_as_fast) && !found.iter().any(|repeat| repeat.runs.contains(index))
    };
    (0..runs.len()).filter(is_untold).collect()
}

/// How fast rows are along their way, while they move, m per row.
fn speed(run: &Run, rows: Range<usize>) -> f64 {
    let step = |row: usize| {
        let squares = run.axes.values().map(|axis| (axis.setpoint_m[row] - axis.setpoint_m[row - 1]).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let mut steps: Vec<f64> =
        (rows.start.max(1)..rows.end).map(step).filter(|step| *step > STILL_M).collect();
    median(&mut steps).unwrap_or(0.0)
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
    apart_s: f64,
}

impl Way {
    /// To these places, the surest first.
    fn all(places: &[Place]) -> impl Iterator<Item = Self> {
        let to = |fade_s: f64, place: Place| APART_S.map(|apart_s| Self { fade_s, place, apart_s });
        FADES_S.into_iter().flat_map(move |fade_s| places.iter().flat_map(move |place| to(fade_s, *place)))
    }

    /// The repeats of some runs, in themselves and with any other.
    fn repeats(self, runs: &[Run], asked: &[usize]) -> Vec<Repeat> {
        let mut found = Vec::new();
        for (index, run) in runs.iter().enumerate() {
            if self.has_laps() && asked.contains(&index) {
                found.extend(
                    laps(index, run, self.rows(run)).or_else(|| motions_again(index, run, self.rows(run))),
                );
            }
            found.extend(self.again(runs, index, asked));
        }
        let is_alone = |index: &usize| found.iter().all(|repeat: &Repeat| !repeat.runs.contains(index));
        let alone: Vec<usize> = asked.iter().copied().filter(is_alone).collect();
        found.extend(self.motions_elsewhere(runs, &alone));
        found
    }

    /// Whether laps come again this way.
    fn has_laps(self) -> bool {
        self.place == Place::Same && self.fade_s == FADE_S
    }

    fn rows(self, run: &Run) -> usize {
        (self.fade_s / run.period_s) as usize
    }

    /// The repeats of a run in those after it, of which one is asked for.
    fn again(self, runs: &[Run], index: usize, asked: &[usize]) -> impl Iterator<Item = Repeat> {
        let run = &runs[index];
        runs.iter()
            .enumerate()
            .skip(index + 1)
            .filter(move |(other, _)| asked.contains(&index) || asked.contains(other))
            .filter(move |(_, twin)| self.is_near(run, twin) && self.is_same_command(run, twin))
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

    /// Whether a run begins soon enough after another, or before it.
    fn is_near(self, run: &Run, twin: &Run) -> bool {
        (run.start_s - twin.start_s).abs() <= self.apart_s
    }

    fn is_same_command(self, run: &Run, twin: &Run) -> bool {
        let rows = run.len().min(twin.len());
        run.len().abs_diff(twin.len()) * 50 < rows && self.is_same(run, 0..rows, twin, 0)
    }

    /// Whether rows of a run were commanded in another from a row on.
    fn is_same(self, run: &Run, rows: Range<usize>, twin: &Run, from: usize) -> bool {
        let most_m = SAME_SHARE * span_of(run, rows.clone());
        from + rows.len() <= twin.len()
            && !run.axes.is_empty()
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
                if self.has_laps() && alone.contains(&index) {
                    let laps = laps(index, &part_of(run, &motion, String::new()), self.rows(run));
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
                    let earlier = Some(&runs[*other]).filter(|earlier| self.is_near(earlier, run))?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::runs::repeat::first_pass;

    const PERIOD_S: f64 = 5e-4;

    /// A motion of an axis from a place.
    fn motion(from_m: f64, way_m: f64) -> Run {
        let rows = 6_000_usize;
        let at = |row: usize| from_m + way_m * (row.saturating_sub(1_000) as f64 / 4_000.0).min(1.0);
        Run::of_setpoints(PERIOD_S, [(AxisId::X, (0..rows).map(at).collect())])
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

    #[test]
    fn what_comes_again_much_later_tells_only_of_what_nothing_else_does() {
        let at = |run: Run, start_s: f64| Run { start_s, ..run };
        let of = |runs: &[Run]| repeats(runs).iter().map(|repeat| repeat.runs).collect::<Vec<_>>();
        let run = motion(0.0, 0.02);
        let hour = [0.0, 20.0, 3_600.0].map(|start_s| at(run.clone(), start_s));
        assert_eq!(of(&hour), [[0, 1]]);
        assert_eq!(of(&[hour[0].clone(), hour[2].clone()]), [[0, 1]], "nothing else comes again");
    }

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
    fn runs_without_an_axis_are_no_passes_of_it() {
        let run = motion(0.0, 0.02);
        let without = Run { axes: Default::default(), ..run.clone() };
        assert!(repeats(&[without, run]).is_empty());
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
