//! What happens in a log, found by what it contains and not by what was planned: so a log of any test serves, a
//! circular test too.
//!
//! | stretch | found by | tells |
//! |---|---|---|
//! | steady | setpoint of constant speed, the axis settled on it without standing in between | sliding friction |
//! | ramp | from rest, a slow setpoint of constant speed | break-away, stiffness |
//! | reversal | the motor slides one way and then the other, without a rest | the falling part of friction |
//! | acceleration | the axis slides on while its speed changes much | inertia |
//!
//! Invariant: stretches lie in one piece each, far enough from its ends for the filter.

use std::ops::Range;

use super::measured::{Measured, Piece};

/// Setpoints that differ by less, relatively, have the same speed.
const SAME_SPEED: f64 = 1e-3;
/// Mean speeds of a settled axis are so near to the setpoint, relatively.
const SETTLED: f64 = 0.01;
/// Over so long a time is a mean speed taken, s.
const BLOCK_S: f64 = 0.05;
/// Shortest settled stretch, s.
const STEADY_MIN_S: f64 = 0.2;
/// An axis that falls below this share of its speed sticks in between.
const STANDS: f64 = 0.4;
/// Fastest setpoint of a ramp, m/s.
const RAMP_MAX_M_PER_S: f64 = 0.12e-3;
/// A ramp starts from a rest at least so long, s.
const REST_MIN_S: f64 = 0.05;
/// Shortest and longest part of a ramp that is looked at, s.
const RAMP_S: [f64; 2] = [0.3, 4.0];
/// Faster than this the axis slides beyond the falling part of friction, m/s.
const SLIDES_M_PER_S: f64 = 2e-3;
/// A reversal takes no longer, s.
const REVERSAL_MAX_S: f64 = 1.5;
/// Least acceleration that tells inertia, m/s².
const ACCELERATION_MIN_M_PER_S2: f64 = 0.1;
/// Shortest acceleration, s, and what belongs to it on either side.
const ACCELERATION_MIN_S: f64 = 0.04;
const AROUND_S: f64 = 0.1;

/// Rows of a piece.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Which piece.
    pub piece: usize,
    /// Its rows.
    pub rows: Range<usize>,
}

/// All stretches of an axis.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stretches {
    /// Settled on a constant speed.
    pub steady: Vec<Stretch>,
    /// From rest at a slow speed, the rest included.
    pub ramps: Vec<Stretch>,
    /// From sliding one way to sliding the other.
    pub reversals: Vec<Stretch>,
    /// Sliding with a changing speed.
    pub accelerations: Vec<Stretch>,
}

impl Stretches {
    /// Those of an axis.
    pub fn of(measured: &Measured) -> Self {
        let mut found = Self::default();
        for (index, piece) in measured.pieces.iter().enumerate() {
            let margin = measured.low_pass.memory_rows();
            if piece.len() <= 2 * margin {
                continue;
            }
            let inner = margin..piece.len() - margin;
            let stretch = |rows: Range<usize>| {
                let rows = rows.start.max(inner.start)..rows.end.min(inner.end);
                Stretch { piece: index, rows }
            };
            let runs = constant_speed(piece, &inner);
            found.steady.extend(runs.iter().filter_map(|run| settled(measured, piece, run)).map(stretch));
            found.ramps.extend(runs.iter().filter_map(|run| ramp(measured, piece, run)).map(stretch));
            found.reversals.extend(reversals(measured, piece, &inner).into_iter().map(stretch));
            found.accelerations.extend(accelerations(measured, piece, &inner).into_iter().map(stretch));
        }
        found
    }
}

/// Runs of rows with the same speed of the setpoint.
fn constant_speed(piece: &Piece, inner: &Range<usize>) -> Vec<Range<usize>> {
    let speed = &piece.setpoint_m_per_s;
    let mut runs: Vec<Range<usize>> = Vec::new();
    for row in inner.clone().filter(|row| speed[*row] != 0.0) {
        match runs.last_mut() {
            Some(run)
                if run.end == row
                    && (speed[row] - speed[run.start]).abs() <= SAME_SPEED * speed[run.start].abs() =>
            {
                run.end = row + 1;
            }
            _ => runs.push(row..row + 1),
        }
    }
    runs
}

/// The part of a run in which the axis has settled and does not stand.
fn settled(measured: &Measured, piece: &Piece, run: &Range<usize>) -> Option<Range<usize>> {
    let block = measured.rows(BLOCK_S);
    let wanted = piece.setpoint_m_per_s[run.start];
    let is_off = |rows: Range<usize>| {
        let way_m = piece.position_m[rows.end - 1] - piece.position_m[rows.start];
        let mean = way_m / ((rows.len() - 1) as f64 * measured.period_s);
        (mean - wanted).abs() > SETTLED * wanted.abs()
    };
    let blocks = run.len() / block;
    let block_at = |number: usize| run.start + number * block..run.start + (number + 1) * block;
    let first = (0..blocks).rev().find(|number| is_off(block_at(*number))).map_or(0, |number| number + 1);
    let rows = run.start + first * block..run.start + blocks * block;
    let stands = |row: usize| piece.velocity_m_per_s[row] / wanted < STANDS;
    (rows.len() >= measured.rows(STEADY_MIN_S) && !rows.clone().any(stands)).then_some(rows)
}

/// A slow run that begins at rest, with that rest.
fn ramp(measured: &Measured, piece: &Piece, run: &Range<usize>) -> Option<Range<usize>> {
    let rest = measured.rows(REST_MIN_S);
    let [shortest, longest] = RAMP_S.map(|time_s| measured.rows(time_s));
    if piece.setpoint_m_per_s[run.start].abs() > RAMP_MAX_M_PER_S || run.len() < shortest {
        return None;
    }
    // The setpoint's own rise to its speed is part of the ramp.
    let is_rest = |row: &usize| piece.setpoint_m_per_s[*row] == 0.0;
    let start = (0..run.start).rev().find(is_rest)?;
    let from = (start + 1).checked_sub(rest)?;
    let is_short = run.start - start <= longest;
    (is_short && (from..=start).all(|row| is_rest(&row))).then(|| from..run.end.min(run.start + longest))
}

/// From the last row of sliding one way to the first of sliding the other.
fn reversals(measured: &Measured, piece: &Piece, inner: &Range<usize>) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut slid: Option<usize> = None;
    let longest = measured.rows(REVERSAL_MAX_S);
    let rest = measured.rows(REST_MIN_S);
    for row in inner.clone() {
        let velocity = piece.velocity_m_per_s[row];
        if velocity.abs() < SLIDES_M_PER_S {
            continue;
        }
        if let Some(last) = slid
            && velocity * piece.velocity_m_per_s[last] < 0.0
            && row - last <= longest
            && piece.setpoint_m_per_s[last..row].iter().filter(|speed| **speed == 0.0).count() < rest
        {
            found.push(last..row + 1);
        }
        slid = Some(row);
    }
    found
}

/// Rows around a large acceleration, for as long as the axis slides one way.
fn accelerations(measured: &Measured, piece: &Piece, inner: &Range<usize>) -> Vec<Range<usize>> {
    let around = measured.rows(AROUND_S);
    let is_large = |row: &usize| {
        piece.acceleration_m_per_s2[*row].abs() > ACCELERATION_MIN_M_PER_S2
            && piece.velocity_m_per_s[*row].abs() > SLIDES_M_PER_S
    };
    let mut found: Vec<Range<usize>> = Vec::new();
    for row in inner.clone().filter(is_large) {
        match found.last_mut() {
            Some(last) if last.end == row => last.end = row + 1,
            _ => found.push(row..row + 1),
        }
    }
    found.retain(|rows| rows.len() >= measured.rows(ACCELERATION_MIN_S));
    let slides = |row: usize, way: f64| piece.velocity_m_per_s[row] * way > SLIDES_M_PER_S;
    for rows in &mut found {
        let way = piece.velocity_m_per_s[rows.start].signum();
        let most = (rows.start.saturating_sub(around), (rows.end + around).min(piece.len()));
        while rows.start > most.0 && slides(rows.start - 1, way) {
            rows.start -= 1;
        }
        while rows.end < most.1 && slides(rows.end, way) {
            rows.end += 1;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::smoothing::LowPass;
    use super::*;

    const PERIOD_S: f64 = 0.5e-3;

    /// An axis that does what it is told, at once.
    fn measured(velocity_m_per_s: impl Fn(f64) -> f64, duration_s: f64) -> Measured {
        let rows = (duration_s / PERIOD_S) as usize;
        let setpoint_m_per_s: Vec<f64> =
            (0..rows).map(|row| velocity_m_per_s(row as f64 * PERIOD_S)).collect();
        let position_m: Vec<f64> = setpoint_m_per_s
            .iter()
            .scan(0.0, |place, speed| {
                *place += speed * PERIOD_S;
                Some(*place)
            })
            .collect();
        let acceleration_m_per_s2 = super::super::smoothing::derivative(&setpoint_m_per_s, PERIOD_S);
        let piece = Piece {
            velocity_m_per_s: setpoint_m_per_s.clone(),
            setpoint_m_per_s,
            position_m,
            acceleration_m_per_s2,
            ..Piece::default()
        };
        let low_pass = LowPass::new(200.0, 1.0 / PERIOD_S).expect("a filter");
        Measured { period_s: PERIOD_S, cutoff_hz: 200.0, pieces: vec![piece], low_pass, left_out_rows: 0 }
    }

    /// Seconds of the only stretch of a kind.
    fn only(stretches: &[Stretch]) -> [f64; 2] {
        assert_eq!(stretches.len(), 1, "{stretches:?}");
        let rows = &stretches[0].rows;
        [rows.start as f64 * PERIOD_S, rows.end as f64 * PERIOD_S]
    }

    #[test]
    fn a_constant_speed_is_steady_once_the_axis_has_settled() {
        let mut measured = measured(|t| if (1.0..3.0).contains(&t) { 0.02 } else { 0.0 }, 4.0);
        // It comes up to its speed as the position loop lets it.
        let piece = &mut measured.pieces[0];
        let mut place = 0.0;
        for row in 0..piece.len() {
            let since_s = row as f64 * PERIOD_S - 1.0;
            let lag = if since_s > 0.0 { 1.0 - (-since_s / 0.117).exp() } else { 0.0 };
            piece.velocity_m_per_s[row] = piece.setpoint_m_per_s[row] * lag;
            place += piece.velocity_m_per_s[row] * PERIOD_S;
            piece.position_m[row] = place;
        }
        let [start_s, end_s] = only(&Stretches::of(&measured).steady);
        // To 1 % after ln 100 time constants: 0.54 s.
        assert!((1.5..1.65).contains(&start_s) && (2.9..=3.0).contains(&end_s), "{start_s} to {end_s} s");
        // One that stands in between does not slide.
        let piece = &mut measured.pieces[0];
        piece.velocity_m_per_s[(2.5 / PERIOD_S) as usize] = 0.0;
        assert!(Stretches::of(&measured).steady.is_empty());
    }

    #[test]
    fn a_slow_run_from_rest_is_a_ramp_with_its_rest() {
        let slow = |t: f64| if (1.0..2.5).contains(&t) { -0.05e-3 } else { 0.0 };
        let [start_s, end_s] = only(&Stretches::of(&measured(slow, 4.0)).ramps);
        assert!((start_s - 0.95).abs() < 2e-3 && (end_s - 2.5).abs() < 2e-3, "{start_s} to {end_s} s");
        let fast = |t: f64| if (1.0..2.5).contains(&t) { -0.2e-3 } else { 0.0 };
        assert!(Stretches::of(&measured(fast, 4.0)).ramps.is_empty(), "0.2 mm/s is no ramp");
        let moving = |t: f64| {
            if t < 1.0 {
                0.01
            } else if t < 2.5 {
                -0.05e-3
            } else {
                0.0
            }
        };
        assert!(Stretches::of(&measured(moving, 4.0)).ramps.is_empty(), "not from rest");
    }

    #[test]
    fn a_reversal_is_in_motion_and_one_with_a_rest_is_none() {
        let turns = |t: f64| 0.008 * (TAU * t / 8.0).cos();
        let [start_s, end_s] = only(&Stretches::of(&measured(turns, 4.0)).reversals);
        // 2 of 8 mm/s are passed 0.32 s before and after.
        assert!((start_s - 1.678).abs() < 5e-3 && (end_s - 2.322).abs() < 5e-3, "{start_s} to {end_s} s");
        let rests = |t: f64| if (1.8..2.2).contains(&t) { 0.0 } else { turns(t) };
        assert!(Stretches::of(&measured(rests, 4.0)).reversals.is_empty());
    }

    #[test]
    fn an_acceleration_reaches_as_far_as_the_axis_slides() {
        let rise = |t: f64| (0.05 * (t - 1.0) / 0.25).clamp(0.0, 0.05);
        let [start_s, end_s] = only(&Stretches::of(&measured(rise, 3.0)).accelerations);
        // 2 mm/s are passed after 10 ms; 0.1 s behind the end belong to it.
        assert!((start_s - 1.01).abs() < 2e-3 && (end_s - 1.35).abs() < 2e-3, "{start_s} to {end_s} s");
        let slow = |t: f64| (0.05 * (t - 1.0) / 1.5).clamp(0.0, 0.05);
        assert!(Stretches::of(&measured(slow, 3.0)).accelerations.is_empty(), "0.03 m/s^2 tells no mass");
    }

    #[test]
    fn nothing_is_found_where_the_filter_feels_the_end_of_the_piece() {
        let run = measured(|_| 0.02, 2.0);
        let margin_s = run.low_pass.memory_rows() as f64 * PERIOD_S;
        let [start_s, end_s] = only(&Stretches::of(&run).steady);
        assert!(start_s >= margin_s && end_s <= 2.0 - margin_s, "{start_s} to {end_s} s");
    }
}
