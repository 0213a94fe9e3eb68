//! Motions: what a run does between two rests, and runs of one motion each out of one that holds several.
//!
//! ```text
//!   run ──► rests: no setpoint changes ──► motions ──► a part for each that comes again by itself, and for what lies between
//! ```
//!
//! Somebody may record circles, small reversals and strokes into one file. As one run nothing of it would come again soon
//! enough to tell the noise, and its end would judge all of it.
//! Invariant: the parts of a run are all of it, in order.

use std::ops::Range;

use super::forward::SETTLE_S;
use super::laps::repeats_itself;
use super::runs::{AxisRun, Run};

/// No setpoint changes for so long where a machine rests, s; what counts as no change, m.
const REST_S: f64 = 0.2;
pub(super) const STILL_M: f64 = 1e-9;
/// A run is taken apart at rests of this length, s, so long before the next motion as the start of a run takes to fade: in a
/// shorter one an axis is still on its way.
const LONG_REST_S: f64 = 0.6;
const BEFORE_S: f64 = SETTLE_S;
/// An axis that rests for so long at first begins later, s.
const IDLE_S: f64 = 2.0;
/// What lies between motions that come again is a part of its own from this length on, s.
const PART_MIN_S: f64 = 3.0;

/// The rows of each motion of a run.
pub(super) fn motions(run: &Run) -> Vec<Range<usize>> {
    let stands = |row: usize| {
        run.axes.values().all(|axis| (axis.setpoint_m[row] - axis.setpoint_m[row - 1]).abs() <= STILL_M)
    };
    let rest = (REST_S / run.period_s) as usize;
    let mut motions: Vec<Range<usize>> = Vec::new();
    for row in (1..run.len()).filter(|row| !stands(*row)) {
        match motions.last_mut().filter(|motion| row < motion.end + rest) {
            Some(motion) => motion.end = row + 1,
            None => motions.push(row - 1..row + 1),
        }
    }
    motions
}

/// Rows of a run in which an axis has something to do, from a while before it first moves until it has come to rest: while the others
/// go on it tells nothing. All of a run that begins with it; nothing where it rests all along.
pub(super) fn busy(axis: &AxisRun, period_s: f64) -> Option<Range<usize>> {
    let rows = axis.setpoint_m.len();
    let moves = |row: &usize| (axis.setpoint_m[*row] - axis.setpoint_m[*row - 1]).abs() > STILL_M;
    let (first, last) = ((1..rows).find(moves)?, (1..rows).rfind(moves)?);
    let in_rows = |time_s: f64| (time_s / period_s) as usize;
    let from = if first < in_rows(IDLE_S) { 0 } else { first - in_rows(BEFORE_S) };
    Some(from..(last + in_rows(REST_S) + 1).min(rows))
}

/// Whether each row of a run tells anything: a loop whose integral winds up while its table sticks lets it slip when chance
/// will, so that rows of a rest say nothing once the way before it has ended.
pub(super) fn tells(run: &Run) -> Vec<bool> {
    let arrives = (REST_S / run.period_s) as usize;
    let mut tells = vec![false; run.len()];
    for motion in motions(run) {
        let to = (motion.end + arrives).min(run.len());
        tells[motion.start..to].fill(true);
    }
    tells
}

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

/// Some rows of a run.
pub(super) fn part_of(run: &Run, rows: &Range<usize>, name: String) -> Run {
    let axis = |axis: &AxisRun| axis.by_columns(|column| column[rows.clone()].to_vec());
    Run {
        name,
        start_s: run.start_s + rows.start as f64 * run.period_s,
        period_s: run.period_s,
        axes: run.axes.iter().map(|(id, columns)| (*id, axis(columns))).collect(),
        is_sound: run.is_sound[rows.clone()].to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::repeats::repeats;
    use super::*;
    use crate::base::axis::AxisId;

    const PERIOD_S: f64 = 5e-4;

    /// A session in one file, as the setpoints of both axes.
    #[derive(Default)]
    struct Session {
        x_m: Vec<f64>,
        y_m: Vec<f64>,
    }

    impl Session {
        fn here(&self) -> [f64; 2] {
            [self.x_m.last().copied().unwrap_or(0.0), self.y_m.last().copied().unwrap_or(0.0)]
        }

        fn rest(mut self, seconds: f64) -> Self {
            let [x, y] = self.here();
            let rows = (seconds / PERIOD_S).round() as usize;
            self.x_m.extend(vec![x; rows]);
            self.y_m.extend(vec![y; rows]);
            self
        }

        fn circle(mut self, laps: f64, lap_s: f64) -> Self {
            let [x, y] = self.here();
            for row in 1..=(laps * lap_s / PERIOD_S).round() as usize {
                let (sin, cos) = (TAU * row as f64 * PERIOD_S / lap_s).sin_cos();
                self.x_m.push(x + 0.02 * (cos - 1.0));
                self.y_m.push(y + 0.02 * sin);
            }
            self
        }

        fn line(mut self, way_m: f64, seconds: f64) -> Self {
            let [x, y] = self.here();
            for row in 1..=(seconds / PERIOD_S).round() as usize {
                self.x_m.push(x + way_m * row as f64 * PERIOD_S / seconds);
                self.y_m.push(y);
            }
            self
        }

        fn run(self) -> Run {
            let setpoints_m = [(AxisId::X, self.x_m), (AxisId::Y, self.y_m)];
            Run { start_s: 7.0, ..Run::of_setpoints(PERIOD_S, setpoints_m) }
        }
    }

    fn strokes(session: Session) -> Session {
        (0..3).fold(session, |session, _| session.line(0.02, 0.7).rest(0.3).line(-0.02, 0.7).rest(0.3))
    }

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
    fn an_axis_is_busy_from_a_while_before_its_first_way_until_it_has_come_to_rest() {
        let session = Session::default().rest(0.5).line(0.02, 1.0);
        let run = session.circle(1.0, 3.0).rest(4.0).run();
        let of = |id: AxisId| busy(&run.axes[&id], PERIOD_S).expect("it moves");
        // What begins with the run is left as it begins.
        assert_eq!(of(AxisId::X), 0..1_000 + 2_000 + 6_000 + 400);
        assert_eq!(of(AxisId::Y), 0..1_000 + 2_000 + 6_000 + 400);
        let later = Session::default().line(0.02, 3.0).circle(1.0, 3.0).run();
        assert_eq!(busy(&later.axes[&AxisId::Y], PERIOD_S), Some(6_000 - 800..12_000));
        let line = Session::default().line(0.02, 3.0).run();
        assert_eq!(busy(&line.axes[&AxisId::Y], PERIOD_S), None);
    }

    #[test]
    fn rests_tell_nothing() {
        let run = Session::default().rest(0.5).line(0.02, 1.0).rest(0.1).line(-0.02, 1.0).rest(0.8).run();
        let tells = tells(&run);
        let told: Vec<usize> = (0..run.len()).filter(|row| tells[*row]).collect();
        // A short rest is part of the motion.
        assert_eq!([told[0], told[told.len() - 1] + 1], [999, 5_200 + 400]);
        assert_eq!(told.len(), 4_601);
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
