//! Promise: a feed that somebody turned down is no effect of an axis: it is said, and what was there takes part in nothing.

use quadrant::offline::gap::locate::rest::Rest;

use super::*;

const LAP_S: f64 = 1.6;

/// Laps of a circle of both axes of a machine as its file has it, of which the log holds what was asked for where nobody turns the
/// feed down; `behind_s` is how far behind that the machine is, from half a lap on for a second.
fn laps(machine: &Machine, name: &str, (radius_mm, behind_s): (f64, f64), seed: u64) -> Run {
    let rows = (3.2 * LAP_S * ROWS_PER_S) as usize;
    let place_m = |axis: AxisId, at_s: f64| {
        let turns = at_s / LAP_S;
        let quarter = if axis == AxisId::X { 0.0 } else { 0.25 * TAU };
        1e-3 * radius_mm * ((TAU * turns + quarter).sin() - quarter.sin()) * (5.0 * turns).min(1.0)
    };
    let late_s = |at_s: f64| {
        let through = (at_s - 0.5 * LAP_S).clamp(0.0, 1.0);
        behind_s * (0.5 * TAU * through).sin().powi(2)
    };
    let times = || (0..rows).map(|row| row as f64 / ROWS_PER_S);
    let blank = |axis: AxisId| {
        let zeros = vec![0.0; rows];
        let setpoint_m = times().map(|at_s| place_m(axis, at_s - late_s(at_s))).collect();
        let row =
            AxisRun { setpoint_m, position_m: zeros.clone(), table_m: Some(zeros.clone()), current_a: zeros };
        (axis, AxisRun { position_m: vec![row.setpoint_m[0]; rows], ..row })
    };
    let mut run = Run {
        name: name.to_owned(),
        start_s: 0.0,
        period_s: 1.0 / ROWS_PER_S,
        axes: [AxisId::X, AxisId::Y].map(blank).into(),
        is_sound: vec![true; rows],
    };
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    for id in [AxisId::X, AxisId::Y] {
        let made = recorded(machine, &run, (id, &machine.axes[id].plant), 0, &mut random);
        let setpoint_m = times().map(|at_s| place_m(id, at_s)).collect();
        run.axes.insert(id, AxisRun { setpoint_m, ..made });
    }
    run
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn a_feed_that_somebody_turned_down_is_said_of_all_axes_and_no_effect_of_any() {
    let machine = config::load("paper").expect("a machine");
    for behind_s in [0.0, 5e-4] {
        let runs = [("slow", (10.0, 0.0)), ("fast", (20.0, behind_s)), ("heldout", (15.0, 0.0))];
        let runs: Vec<Run> =
            runs.into_iter().zip(1..).map(|((name, of), seed)| laps(&machine, name, of, seed)).collect();
        let analysis = analysed(&machine, &runs);
        assert_eq!(analysis.axes.len(), 2);
        for axis in &analysis.axes {
            assert!(axis.named.effects.is_empty(), "{behind_s}: {:?}", axis.named.effects);
            let left = axis.named.model.cost / axis.named.rows[0] as f64;
            assert!(left < 1.1, "{behind_s}: {left} of noise");
            match axis.rest {
                Some(Rest::Behind { runs: 1, by_s }) if behind_s > 0.0 => {
                    assert!((by_s / behind_s - 1.0).abs() < 0.15, "{by_s} s");
                    assert_eq!(axis.verdict, Verdict::Unknown);
                }
                None if behind_s == 0.0 => assert_eq!(axis.verdict, Verdict::NothingMissing),
                rest => panic!("{behind_s}: {rest:?}"),
            }
        }
    }
}
