//! The objective over `V_p` and `V_i`, all else as chosen: for the picture, and to hold the search against.
//!
//! Invariant: points are judged as in the search.

use rayon::prelude::*;

use super::judge::{Held, violation};
use super::space::Choice;
use super::{Request, Valuer};
use crate::config::Machine;

/// What is at one point.
#[derive(Clone, Debug)]
pub struct Point {
    /// The gains.
    pub choice: Choice,
    /// The first objective; infinite where the loops do not keep their margins and nothing was run.
    pub objective: f64,
    /// By which share each constraint is broken, negative where it is kept; in the order of the names.
    pub broken_by: Vec<f64>,
    /// All that is broken, together.
    pub violation: f64,
}

/// A grid of points, even in the logarithms.
#[derive(Clone, Debug)]
pub struct Map {
    /// Values of `V_p`, rising.
    pub v_p: Vec<f64>,
    /// Values of `V_i`, rising.
    pub v_i: Vec<f64>,
    /// Names of the constraints.
    pub constraints: Vec<String>,
    /// Points, row by row of `V_i`.
    pub points: Vec<Point>,
}

impl Map {
    /// Around a choice, between ends of `V_p` and `V_i`, with so many values of each. Nothing is run where the
    /// loops do not keep their margins.
    pub fn of(
        machine: &Machine,
        request: &Request,
        choice: Choice,
        ends: [[f64; 2]; 2],
        steps: usize,
    ) -> Self {
        let valuer = Valuer::new(machine, request);
        Self::by(choice, ends, steps, |choice| valuer.worth(choice))
    }

    /// The same, run everywhere: for a picture.
    pub fn everywhere(
        machine: &Machine,
        request: &Request,
        choice: Choice,
        ends: [[f64; 2]; 2],
        steps: usize,
    ) -> Self {
        let valuer = Valuer::new(machine, request);
        Self::by(choice, ends, steps, |choice| valuer.explored(choice))
    }

    fn by(
        choice: Choice,
        [v_p, v_i]: [[f64; 2]; 2],
        steps: usize,
        worth: impl Fn(&Choice) -> (Vec<f64>, Vec<Held>) + Sync,
    ) -> Self {
        let even = |[low, high]: [f64; 2]| -> Vec<f64> {
            let share = |step: usize| step as f64 / (steps - 1) as f64;
            (0..steps).map(|step| low * (high / low).powf(share(step))).collect()
        };
        let (v_p, v_i) = (even(v_p), even(v_i));
        let places: Vec<[f64; 2]> = v_i.iter().flat_map(|v_i| v_p.iter().map(|v_p| [*v_p, *v_i])).collect();
        let point = |[v_p, v_i]: &[f64; 2]| {
            let choice = Choice { v_p: *v_p, v_i: *v_i, ..choice };
            let (objectives, held) = worth(&choice);
            let broken_by = held.iter().map(|held| held.broken_by()).collect();
            Point { choice, objective: objectives[0], broken_by, violation: violation(&held) }
        };
        let points = places.par_iter().map(point).collect();
        let constraints = worth(&choice).1.into_iter().map(|held| held.name).collect();
        Self { v_p, v_i, constraints, points }
    }

    /// The best of its points that keep all constraints.
    pub fn best(&self) -> Option<&Point> {
        let kept = self.points.iter().filter(|point| point.violation <= 0.0);
        kept.min_by(|a, b| a.objective.total_cmp(&b.objective))
    }
}
