//! A model fitted to the runs of an axis in closed loop: Gauss and Newton with Levenberg's damping, on whitened
//! residuals, with what is believed of each coordinate beforehand.
//!
//! ```text
//!   minimise  Σ ρ(residual) + Σ ((coordinate - expected) / sureness)²      ρ a square up to a knee, bounded beyond
//! ```
//!
//! A candidate is fitted beside a model that was fitted before with the derivatives that are known of that one: only
//! its own are computed anew, and what is left always is.
//!
//! The landscape is rough: where a model lands on another branch of stick and slip, the cost jumps. So the knee begins
//! where the residual is and comes nearer, and where a fine fit ends it looks along its valley for a deeper place.
//! Invariant: a fit never ends worse than it began, at the knee it ends with.

mod apart;
pub(super) mod blocks;
mod fitted;
mod kicks;
pub(super) mod louder;
pub mod nearby;
pub(super) mod refit;

use nalgebra::{DMatrix, DVector};

use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{BLOCK_S, K, LEAST_CURVATURE, Linear, Loss, Normal, residuals};
use crate::offline::gap::model::problem::{Problem, Residual};
use crate::offline::gap::model::steps::Steps;

pub use fitted::Fitted;
use kicks::{best_of, kicked_from};

/// Damping at the start, by how much it falls and grows, and how often it may grow before a step is given up: the first by new derivatives,
/// and a further one by the same.
const DAMPING: (f64, f64, [usize; 2]) = (1e-3, 6.0, [6, 2]);
/// No step is further, in coordinates.
const FURTHEST: f64 = 1.5;
/// Most steps with the same derivatives, and the share of what the first gained that makes another one worth it.
const PASSES: usize = 6;
const WORTH: f64 = 0.1;
/// Share of what makes a step worth it that derivatives must promise: it may gain somewhat more than they say.
const PROMISED: f64 = 0.5;
/// Share of what is enough to go on that the next iteration of a coarse fit must gain, if it gains as much less than this one as this one did
/// than the one before: what closes in so fast has come to its end.
const NEXT: f64 = 0.3;
/// Share of the rows that may be events of stick and slip: where more are beyond the knee of `ρ` the model is off. And by
/// how much the knee must come nearer to make it another fit.
const EVENTS: f64 = 0.01;
const NEARER: f64 = 0.95;
/// A coarse fit ends with an iteration that gains less than this share of the cost, as that judges ([`LEAST_PER_ROW`]): the first of a base,
/// of whose depth is told whether anything is missing, the second of a candidate beside it. A fine one ends with half a unit of the logarithm
/// of probability: the cost has two.
const ENOUGH: ([f64; 2], f64) = ([1e-4, 1e-3], 1.0);
/// Less than this is never left per row, in units of the floor: a floor that counts what an encoder hides twice is too
/// high, but not by more.
pub const LEAST_PER_ROW: f64 = 0.5;
/// From where a fine fit ends it looks along its valley, and goes on from there at most so often.
const KICKED: usize = 2;
/// How often derivatives over narrower steps may gain nothing: where it is rough, they are never as narrow as they should be.
const IDLE: usize = 2;
/// Most iterations of a fine fit.
const ITERATIONS_MAX: usize = 14;
/// How far a fit goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// So many iterations at most, and fewer where each gains little: to see which candidate is worth more.
    Coarse(usize),
    /// To the bottom: values and costs that are told.
    Fine,
}

/// What the coordinates of a model cost by what is believed of them.
pub fn believed(model: &Model) -> f64 {
    let (at, expected, sureness) = (model.coordinates(), model.expected(), model.sureness());
    at.iter().zip(expected).zip(sureness).map(|((at, expected), sure)| ((at - expected) / sure).powi(2)).sum()
}

/// The model fitted from where it stands; with the derivatives of `known` for the coordinates that it has.
pub fn fit(problem: &Problem<'_>, start: &Model, effort: Effort, known: Option<&Linear>) -> Fitted {
    ending(problem, start, effort, known).0
}

/// A fitted model fitted to the bottom, by derivatives as narrow as it is known.
pub(super) fn to_the_bottom(problem: &Problem<'_>, from: &Fitted) -> Fitted {
    let steps = Steps::of(&from.model, &from.covariance);
    by_steps(problem, &from.model, Effort::Fine, None, steps).0
}

/// The same as [`fit`], and whether it ended before its effort did: more of the same would gain nothing.
pub(super) fn ending(
    problem: &Problem<'_>,
    start: &Model,
    effort: Effort,
    known: Option<&Linear>,
) -> (Fitted, bool) {
    by_steps(problem, start, effort, known, Steps::widest(start))
}

fn by_steps(
    problem: &Problem<'_>,
    start: &Model,
    effort: Effort,
    known: Option<&Linear>,
    mut steps: Steps,
) -> (Fitted, bool) {
    let block = problem.rows_in(BLOCK_S);
    let rows = problem.count(Part::Fit);
    let iterations = match effort {
        Effort::Coarse(iterations) => iterations,
        Effort::Fine => ITERATIONS_MAX,
    };
    let mut model = start.clone();
    let mut damping = DAMPING.0;
    let mut left = residuals(problem, &model, Part::Fit);
    let enough_of = |share: f64, total: f64| match effort {
        Effort::Coarse(_) => share * rows as f64 * scale(total, rows),
        Effort::Fine => ENOUGH.1 * scale(total, rows),
    };
    let enough = |total: f64| enough_of(ENOUGH.0[usize::from(!start.is_base())], total);
    // Far from the minimum all rows are far off: they count by their square until they are near.
    let mut knee = knee(&left);
    let mut covariance = DMatrix::zeros(model.coordinate_count(), model.coordinate_count());
    let (mut kicked, mut idle, mut has_ended) = (0, 0, false);
    // Of the iteration before, with the same knee.
    let mut gained_before = 0.0;
    for _ in 0..iterations {
        let loss = Loss::bounded(knee);
        let mut total = sum(&left, loss) + believed(&model);
        let mut linear = Linear::new(problem, &model, (Part::Fit, left), known, &steps);
        let before = total;
        let mut first_gain = 0.0;
        let mut was_fine = false;
        // Derivatives cost the most: they serve for as long as they gain, and learn from each step.
        for pass in 0..PASSES {
            let equations = linear.normal(block, loss).with_beliefs(&model);
            if pass == 0 {
                if let Some(found) = equations.covariance() {
                    covariance = found;
                }
                was_fine = steps.is_fine_for(&model, &covariance);
                if effort == Effort::Fine {
                    steps = Steps::of(&model, &covariance);
                }
            }
            // At a bottom nothing need be tried to know it.
            let worth_it = match pass {
                0 => enough_of(ENOUGH.0[0], total),
                // Far off, what a base gains so is little beside the first and much by itself.
                _ if start.is_base() => 0.0,
                _ => WORTH * first_gain,
            };
            if equations.promise() < PROMISED * worth_it {
                break;
            }
            let tries = DAMPING.2[usize::from(pass > 0)];
            let Some((other, other_left, other_total)) =
                stepped(problem, &model, &equations, (total, loss), (&mut damping, tries))
            else {
                break;
            };
            let gained = total - other_total;
            let step = DVector::from(other.coordinates()) - DVector::from(model.coordinates());
            (model, total) = (other, other_total);
            first_gain = f64::max(first_gain, gained);
            if pass + 1 == PASSES || gained < WORTH * first_gain {
                linear.leaves(other_left);
                break;
            }
            linear.after(&step, other_left, &steps);
        }
        left = linear.runs.into_iter().map(|run| run.residual).collect();
        let gained = before - total;
        if gained == 0.0 {
            damping = DAMPING.0;
        }
        let nearer = self::knee(&left);
        if nearer < NEARER * knee {
            (knee, gained_before) = (nearer, 0.0);
            continue;
        }
        let closes_in = effort != Effort::Fine && gained * gained < NEXT * enough(total) * gained_before;
        gained_before = gained;
        let is_little = gained < enough(total) || closes_in;
        idle = if is_little { idle + 1 } else { 0 };
        // What derivatives over wide steps do not gain, those over narrow ones may.
        let is_over = is_little && (effort != Effort::Fine || was_fine || idle > IDLE);
        if is_over {
            // A minimum among rough ones: another may lie along the valley. What leaves no more than noise is held up nowhere.
            let may_be_kicked =
                effort == Effort::Fine && kicked < KICKED && sum(&left, Loss::LAST) > rows as f64;
            let kicks = || best_of(problem, &kicked_from(&model, &covariance), loss);
            let deeper = may_be_kicked.then(kicks).flatten();
            let deeper = deeper.filter(|(.., other_total)| total - other_total >= enough(total));
            let Some((other, other_left, _)) = deeper else {
                has_ended = true;
                break;
            };
            (kicked, idle) = (kicked + 1, 0);
            (model, left) = (other, other_left);
            damping = DAMPING.0;
        }
    }
    let cost = sum(&left, Loss::LAST);
    let total = cost + believed(&model);
    (Fitted { model, cost, total, covariance }, has_ended)
}

/// What is left per row.
pub(super) fn scale(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64).max(LEAST_PER_ROW)
}

/// What all rows are within but for [`EVENTS`], and never less than what judges.
pub(super) fn knee(left: &[Residual]) -> f64 {
    // Rows that do not count are zero.
    let mut sizes: Vec<f64> =
        left.iter().flatten().flatten().map(|value| value.abs()).filter(|size| *size > 0.0).collect();
    let within = (sizes.len() as f64 * (1.0 - EVENTS)) as usize;
    if within >= sizes.len() {
        return K;
    }
    let (_, knee, _) = sizes.select_nth_unstable_by(within, f64::total_cmp);
    knee.max(K)
}

/// What a model costs of the rows it is fitted to, and by what is believed of it.
pub fn total_of(problem: &Problem<'_>, model: &Model) -> f64 {
    left_by(problem, model, Loss::LAST).1
}

/// What a model leaves of all runs, and the total.
pub(super) fn left_by(problem: &Problem<'_>, model: &Model, loss: Loss) -> (Vec<Residual>, f64) {
    let left = residuals(problem, model, Part::Fit);
    let total = sum(&left, loss) + believed(model);
    (left, total)
}

fn sum(left: &[Residual], loss: Loss) -> f64 {
    left.iter().map(|run| loss.sum(run)).sum()
}

/// The step that equations ask for, damped until it gains: the model, what it leaves, and the total.
fn stepped(
    problem: &Problem<'_>,
    model: &Model,
    equations: &Normal,
    (total, loss): (f64, Loss),
    (damping, tries): (&mut f64, usize),
) -> Option<(Model, Vec<Residual>, f64)> {
    let at = model.coordinates();
    let factor = DAMPING.1;
    for _ in 0..tries {
        let mut damped = equations.curvature.clone();
        for place in 0..damped.nrows() {
            damped[(place, place)] += *damping * damped[(place, place)].max(LEAST_CURVATURE);
        }
        if let Some(other) = moved(model, &at, damped, &equations.slope) {
            let (left, other_total) = left_by(problem, &other, loss);
            if other_total < total {
                *damping = (*damping / factor).max(1e-9);
                return Some((other, left, other_total));
            }
        }
        *damping *= factor;
    }
    None
}

/// Which share of a step stays where the derivatives hold: more than a few priors leave it.
pub(super) fn share_that_holds(step: &DVector<f64>) -> f64 {
    let largest = step.amax();
    if largest > FURTHEST { FURTHEST / largest } else { 1.0 }
}

/// The model a step further down. A coordinate that its end holds back is left there, and the others go where they go
/// without it.
fn moved(model: &Model, at: &[f64], mut curvature: DMatrix<f64>, slope: &DVector<f64>) -> Option<Model> {
    let mut slope = slope.clone();
    for _ in 0..at.len() {
        let step = curvature.clone().cholesky()?.solve(&slope);
        let share = share_that_holds(&step);
        let tried: Vec<f64> = at.iter().zip(step.iter()).map(|(at, step)| at - share * step).collect();
        let other = model.at(&tried);
        let reached = other.coordinates();
        let is_held = |place: &usize| reached[*place] == at[*place] && tried[*place] != at[*place];
        let held: Vec<usize> = (0..at.len()).filter(is_held).collect();
        if held.is_empty() {
            return Some(other);
        }
        for place in held {
            curvature.row_mut(place).fill(0.0);
            curvature.column_mut(place).fill(0.0);
            curvature[(place, place)] = 1.0;
            slope[place] = 0.0;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::model::Tried;
    use crate::offline::gap::model::twin::BASE;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    const MASS: usize = 0;

    /// Where the current loop stands among the coordinates.
    fn current_loop() -> usize {
        BASE.iter().position(|base| base.name == "current_loop").expect("a parameter")
    }

    /// An axis whose current loop is as slow as it may be.
    fn slow() -> Model {
        let model = Model::new(paper_axis());
        let mut at = model.coordinates();
        at[current_loop()] = -6.0;
        let slow = model.at(&at);
        assert!(slow.base[current_loop()] > -2.0, "the data sheet is worth something");
        slow
    }

    #[test]
    fn the_knee_is_where_all_but_events_are_within() {
        let left = |far: usize, by: f64| -> Vec<Residual> {
            let rows = (0..1_000).map(|row| if row < far { by } else { -0.5 }).chain([0.0; 500]);
            vec![vec![rows.collect()]]
        };
        assert_eq!(knee(&left(9, 300.0)), K, "events");
        assert_eq!(knee(&left(60, 30.0)), 30.0, "a run that the model does not follow");
        assert_eq!(knee(&[]), K);
    }

    #[test]
    fn what_an_end_holds_back_is_left_there_and_the_rest_goes_on_without_it() {
        let model = slow();
        let at = model.coordinates();
        let mut curvature = DMatrix::identity(at.len(), at.len());
        curvature[(MASS, current_loop())] = 0.9;
        curvature[(current_loop(), MASS)] = 0.9;
        // Slower still, and lighter.
        let mut slope = DVector::zeros(at.len());
        slope[MASS] = 0.3;
        slope[current_loop()] = 0.5;
        let to = moved(&model, &at, curvature, &slope).expect("a step").coordinates();
        assert_eq!(to[current_loop()], at[current_loop()]);
        assert!((to[MASS] - (at[MASS] - 0.3)).abs() < 1e-12, "{}", to[MASS]);
    }

    #[test]
    fn a_size_is_no_surer_than_laws_agree_and_a_frequency_is() {
        let values = [0.02, 40.0, 0.0];
        let model = slow().with(Tried { entry: entry("torque-disturbance").expect("an effect"), values });
        let covariance = 1e-12 * DMatrix::identity(model.coordinate_count(), model.coordinate_count());
        let fitted = Fitted { model, cost: 0.0, total: 0.0, covariance };
        for (key, value, [low, high]) in fitted.effect(0) {
            let share = (high - low) / (2.0 * value);
            match key {
                "torque-nm" => assert!((0.08..0.12).contains(&share), "{share}"),
                "frequency-hz" => assert!(share < 1e-5, "{share}"),
                _ => {}
            }
        }
    }

    #[test]
    fn an_amplitude_is_sure_where_the_base_could_stand_for_it_no_further() {
        let lag = Tried { entry: entry("current-loop-lag").expect("an effect"), values: [800.0, 0.0, 0.0] };
        let model = slow().with(lag);
        let place = model.first_coordinate(0);
        let fitted = |other: usize| {
            let mut covariance = DMatrix::identity(model.coordinate_count(), model.coordinate_count());
            // Less of the other stands for the lag, but for a hundredth.
            for (row, column) in [(place, other), (other, place)] {
                covariance[(row, column)] = 0.9999;
            }
            Fitted { model: model.clone(), cost: 0.0, total: 0.0, covariance }
        };
        assert!(fitted(current_loop()).is_surely_not_zero(place, 4.0));
        assert!(!fitted(MASS).is_surely_not_zero(place, 4.0));
    }

    #[test]
    fn an_amplitude_is_sure_whatever_its_time_is_not() {
        let growth = Tried { entry: entry("thermal-growth").expect("an effect"), values: [20.0, 600.0, 0.0] };
        let model = slow().with(growth);
        let place = model.first_coordinate(0);
        let wide = 10.0 * model.coordinates()[place];
        let fitted = |with: usize| {
            let mut covariance = DMatrix::identity(model.coordinate_count(), model.coordinate_count());
            covariance[(place, place)] = wide * wide;
            for (row, column) in [(place, with), (with, place)] {
                covariance[(row, column)] = 0.9999 * wide;
            }
            Fitted { model: model.clone(), cost: 0.0, total: 0.0, covariance }
        };
        assert!(fitted(place + 1).is_surely_not_zero(place, 4.0), "twice as much in twice the time");
        assert!(!fitted(MASS).is_surely_not_zero(place, 4.0));
    }
}
