//! Promise: a run costs a model on average about where it stands what it costs at the bottom of a smooth valley, and what a
//! hole hides.

use quadrant::offline::gap::fit::Fitted;
use quadrant::offline::gap::fit::nearby::costs_nearby;
use quadrant::offline::gap::model::linear::{Loss, residuals};

use super::*;

#[test]
fn a_smooth_run_costs_a_little_more_about_its_bottom() {
    let machine = config::load("paper").expect("a machine");
    let runs = runs(&machine, &[]);
    let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0; 3]);
    let fitted = fit(&problem, &Model::new(machine.axes[AxisId::X].plant), Effort::Fine, None);
    let own: Vec<f64> =
        residuals(&problem, &fitted.model, Part::Fit).iter().map(|run| Loss::LAST.sum(run)).collect();
    let more = |covariance_share: f64| -> Vec<f64> {
        let near = Fitted { covariance: covariance_share * &fitted.covariance, ..fitted.clone() };
        costs_nearby(&problem, &near).iter().zip(&own).map(|(near, own)| near - own).collect()
    };
    assert!(more(1e-12).iter().all(|more| more.abs() < 0.1), "{:?}", more(1e-12));
    // What moves it by a standard deviation each way costs about one for each coordinate, and more where rows are not independent.
    let all: f64 = more(1.0).iter().sum();
    assert!((5.0..500.0).contains(&all), "{all}");
    assert_eq!(more(1.0), more(1.0));
}
