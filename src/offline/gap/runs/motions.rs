//! Motions: what a run does between two rests.
//!
//! Invariant: the setpoints alone say where they begin and end.

use std::ops::Range;

use super::{AxisRun, Run, SETTLE_S};

/// No setpoint changes for so long where a machine rests, s; what counts as no change, m.
const REST_S: f64 = 0.2;
pub(in crate::offline::gap) const STILL_M: f64 = 1e-9;
/// So long before its first way an axis is looked at, s: as the start of a run takes to fade.
pub(super) const BEFORE_S: f64 = SETTLE_S;
/// An axis that rests for so long at first begins later, s.
const IDLE_S: f64 = 2.0;

/// The rows of each motion of a run.
pub(in crate::offline::gap) fn motions(run: &Run) -> Vec<Range<usize>> {
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
pub(in crate::offline::gap) fn busy(axis: &AxisRun, period_s: f64) -> Option<Range<usize>> {
    let rows = axis.setpoint_m.len();
    let moves = |row: &usize| (axis.setpoint_m[*row] - axis.setpoint_m[*row - 1]).abs() > STILL_M;
    let (first, last) = ((1..rows).find(moves)?, (1..rows).rfind(moves)?);
    let in_rows = |time_s: f64| (time_s / period_s) as usize;
    let from = if first < in_rows(IDLE_S) { 0 } else { first - in_rows(BEFORE_S) };
    Some(from..(last + in_rows(REST_S) + 1).min(rows))
}

/// Whether each row of a run tells anything: a loop whose integral winds up while its table sticks lets it slip when chance
/// will, so that rows of a rest say nothing once the way before it has ended.
pub(in crate::offline::gap) fn tells(run: &Run) -> Vec<bool> {
    let arrives = (REST_S / run.period_s) as usize;
    let mut tells = vec![false; run.len()];
    for motion in motions(run) {
        let to = (motion.end + arrives).min(run.len());
        tells[motion.start..to].fill(true);
    }
    tells
}

/// Some rows of a run.
pub(in crate::offline::gap) fn part_of(run: &Run, rows: &Range<usize>, name: String) -> Run {
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
pub(in crate::offline::gap) mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::base::axis::AxisId;

    pub(in crate::offline::gap::runs) const PERIOD_S: f64 = 5e-4;

    /// A session in one file, as the setpoints of both axes.
    #[derive(Default)]
    pub(in crate::offline::gap::runs) struct Session {
        x_m: Vec<f64>,
        y_m: Vec<f64>,
    }

    impl Session {
        fn here(&self) -> [f64; 2] {
            [self.x_m.last().copied().unwrap_or(0.0), self.y_m.last().copied().unwrap_or(0.0)]
        }

        pub(in crate::offline::gap::runs) fn rest(mut self, seconds: f64) -> Self {
            let [x, y] = self.here();
            let rows = (seconds / PERIOD_S).round() as usize;
            self.x_m.extend(vec![x; rows]);
            self.y_m.extend(vec![y; rows]);
            self
        }

        pub(in crate::offline::gap::runs) fn circle(mut self, laps: f64, lap_s: f64) -> Self {
            let [x, y] = self.here();
            for row in 1..=(laps * lap_s / PERIOD_S).round() as usize {
                let (sin, cos) = (TAU * row as f64 * PERIOD_S / lap_s).sin_cos();
                self.x_m.push(x + 0.02 * (cos - 1.0));
                self.y_m.push(y + 0.02 * sin);
            }
            self
        }

        pub(in crate::offline::gap::runs) fn line(mut self, way_m: f64, seconds: f64) -> Self {
            let [x, y] = self.here();
            for row in 1..=(seconds / PERIOD_S).round() as usize {
                self.x_m.push(x + way_m * row as f64 * PERIOD_S / seconds);
                self.y_m.push(y);
            }
            self
        }

        pub(in crate::offline::gap::runs) fn run(self) -> Run {
            let setpoints_m = [(AxisId::X, self.x_m), (AxisId::Y, self.y_m)];
            Run { start_s: 7.0, ..Run::of_setpoints(PERIOD_S, setpoints_m) }
        }
    }

    pub(in crate::offline::gap::runs) fn strokes(session: Session) -> Session {
        (0..3).fold(session, |session, _| session.line(0.02, 0.7).rest(0.3).line(-0.02, 0.7).rest(0.3))
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
}
