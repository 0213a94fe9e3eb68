//! Derivatives that learn from the steps taken with them (Broyden 1965): each is one more difference, in its direction.
//!
//! ```text
//!   T' = T + (r' - r - T s) sᵀ / sᵀ s      s = step      r, r' = what is left before and after it
//! ```
//!
//! New derivatives cost a simulation for each coordinate, and these none.
//! Invariant: along the step they say what it did, and across it what they said before.

use std::sync::Arc;

use nalgebra::DVector;
use rayon::prelude::*;

use super::linear::{Linear, LinearRun};
use super::problem::Residual;
use super::steps::Steps;

impl Linear {
    /// Where a step led that leaves this. One that is narrower than those of derivatives tells less than they do: it may be all
    /// roughness.
    pub(in crate::offline::gap) fn after(&mut self, step: &DVector<f64>, left: Vec<Residual>, steps: &Steps) {
        if !steps.are_within(step) {
            return self.leaves(left);
        }
        let share = step / step.norm_squared();
        let learn = |(run, left): (&mut LinearRun, Residual)| {
            let mut off = run.moved(step);
            off.iter_mut().flatten().zip(left.iter().flatten()).for_each(|(off, left)| *off = left - *off);
            for (column, share) in
                run.columns.iter_mut().zip(share.iter()).filter(|(_, share)| **share != 0.0)
            {
                let Some(column) = column else { continue };
                let rows = Arc::make_mut(column).iter_mut().flatten();
                rows.zip(off.iter().flatten()).for_each(|(value, off)| *value += share * off);
            }
            run.residual = left;
        };
        self.runs.par_iter_mut().zip(left).for_each(learn);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::model::Model;
    use crate::plant::tests::paper_axis;

    /// What two coordinates of a model change, by a size, of a run of three rows of one signal that leaves nothing: a step with
    /// them leaves this.
    fn stepped(size: f64, left: [f64; 3]) -> (LinearRun, [DVector<f64>; 2]) {
        let model = Model::new(paper_axis());
        let steps = Steps::widest(&model);
        let step = |first: f64, second: f64| {
            let mut step = DVector::zeros(model.coordinate_count());
            (step[0], step[1]) = (first, second);
            step
        };
        let mut columns = vec![None; model.coordinate_count()];
        columns[0] = Some(Arc::new(vec![vec![1.0, 2.0, 3.0]]));
        columns[1] = Some(Arc::new(vec![vec![-1.0, 0.0, 5.0]]));
        let run = LinearRun { residual: vec![vec![0.0; 3]], columns };
        let mut linear = Linear { model: model.clone(), runs: vec![run] };
        let along = step(size, 0.5 * size);
        linear.after(&along, vec![vec![left.to_vec()]], &steps);
        (linear.runs.remove(0), [along, step(-0.5 * size, size)])
    }

    /// What the columns of a run say that a step changes.
    fn foretold(run: &LinearRun, step: &DVector<f64>) -> Vec<f64> {
        LinearRun { residual: vec![vec![0.0; 3]], columns: run.columns.clone() }.moved(step).remove(0)
    }

    #[test]
    fn derivatives_say_what_a_step_did_and_across_it_what_they_said() {
        let (run, [along, across]) = stepped(0.2, [0.7, -0.1, 0.3]);
        assert_eq!(run.residual[0], [0.7, -0.1, 0.3]);
        let is_near = |values: Vec<f64>, wanted: [f64; 3]| {
            values.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12)
        };
        assert!(is_near(foretold(&run, &along), [0.7, -0.1, 0.3]), "{:?}", foretold(&run, &along));
        // -0.1 (1, 2, 3) + 0.2 (-1, 0, 5)
        assert!(is_near(foretold(&run, &across), [-0.3, -0.2, 0.7]), "{:?}", foretold(&run, &across));
    }

    #[test]
    fn a_step_narrower_than_those_of_derivatives_teaches_nothing() {
        let (run, _) = stepped(0.02, [0.7, -0.1, 0.3]);
        assert_eq!(run.residual[0], [0.7, -0.1, 0.3]);
        assert_eq!(**run.columns[0].as_ref().expect("a column"), vec![vec![1.0, 2.0, 3.0]]);
    }
}
