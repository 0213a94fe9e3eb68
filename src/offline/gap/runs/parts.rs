//! Runs of one kind of motion each, out of one that holds several.
//!
//! ```text
//!   run ──► rests: no setpoint changes ──► motions ──► a part for each that comes again by itself, and for what lies between
//! ```
//!
//! Somebody may record circles, small reversals and strokes into one file. As one run nothing of it would come again soon
//! enough to tell the noise, and its end would judge all of it.
//! Invariant: the parts of a run are all of it, in order.

use std::ops::Range;

use super::Run;
use super::laps::laps;
use super::motions::{BEFORE_S, motions, part_of};
use super::repeat::FADE_S;

/// A run is taken apart at rests of this length, s, so long before the next motion as the start of a run takes to fade: in a
/// shorter one an axis is still on its way.
const LONG_REST_S: f64 = 0.6;
/// What lies between motions that come again is a part of its own from this length on, s.
const PART_MIN_S: f64 = 3.0;

/// A run taken apart where a motion that comes again by itself begins or ends.
pub(super) fn taken_apart(run: Run) -> Vec<Run> {
    let motions = motions(&run);
    let comes_again: Vec<bool> =
        motions.iter().map(|rows| repeats_itself(&part_of(&run, rows, String::new()))).collect();
    let least = (PART_MIN_S / run.period_s) as usize;
    let before = (BEFORE_S / run.period_s) as usize;
    let rest = (LONG_REST_S / run.period_s) as usize;
    let mut cuts = vec![0];
    for place in 1..motions.len() {
        let (last, next) = (motions[place - 1].end, motions[place].start);
        if next < last + rest {
            continue;
        }
        let cut = next - before;
        let is_edge = comes_again[place - 1] || comes_again[place];
        // A way to where the next motion begins is a part of that one.
        let is_long = |rows: Range<usize>| rows.len() >= least;
        let last = cuts[cuts.len() - 1];
        if is_edge && is_long(last..cut) && (comes_again[place] || is_long(cut..run.len())) {
            cuts.push(cut);
        }
    }
    if cuts.len() == 1 {
        return vec![run];
    }
    cuts.push(run.len());
    let part = |(number, ends): (usize, &[usize])| {
        part_of(&run, &(ends[0]..ends[1]), format!("{}, part {}", run.name, number + 1))
    };
    cuts.windows(2).enumerate().map(part).collect()
}

/// Whether a run is one of laps.
fn repeats_itself(run: &Run) -> bool {
    laps(0, run, (FADE_S / run.period_s) as usize).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::offline::gap::runs::motions::tests::{PERIOD_S, Session, strokes};
    use crate::offline::gap::runs::repeats::repeats;

    #[test]
    fn what_comes_again_by_itself_is_a_part() {
        let session = Session::default().rest(0.3).circle(2.0, 3.0).rest(0.8).line(0.01, 0.5).rest(0.7);
        // The way between two circles is no run of its own.
        let session = session.circle(2.0, 4.0).rest(0.7).line(0.03, 2.0).rest(0.3).line(-0.03, 1.0).rest(0.3);
        let run = strokes(session).run();
        let parts = taken_apart(run.clone());
        let names: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
        assert_eq!(names, ["all, part 1", "all, part 2", "all, part 3"]);
        assert_eq!(parts.iter().map(Run::len).sum::<usize>(), run.len());
        let second = 0.3 + 6.0 + 0.8 - BEFORE_S;
        assert!((parts[1].start_s - 7.0 - second).abs() < 2.0 * PERIOD_S, "{}", parts[1].start_s);
        assert_eq!(
            parts[1].axes[&AxisId::X].setpoint_m[0],
            run.axes[&AxisId::X].setpoint_m[(second / PERIOD_S) as usize]
        );
        let repeats = repeats(&parts);
        let of: Vec<(usize, f64)> = repeats.iter().map(|repeat| (repeat.runs[0], repeat.shift)).collect();
        assert_eq!(of, [(0, 6_000.0), (1, 8_000.0), (2, 4_000.0)], "laps, and strokes behind others");
    }

    #[test]
    fn what_is_one_motion_stays_whole() {
        let circle = Session::default().rest(0.3).circle(3.0, 3.0).rest(0.5).run();
        let lines = strokes(Session::default().rest(0.3)).run();
        for run in [circle, lines] {
            assert_eq!(taken_apart(run.clone()), [run]);
        }
    }
}
