//! Promise: what is left where no command comes again is nothing that is said to be real.

use quadrant::base::axis::AxisId;
use quadrant::config;
use quadrant::offline::gap::show::verdict::Verdict;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use super::{NOISE_A, ROWS_PER_S, analysed, runs};

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_is_left_where_nothing_comes_again_may_be_noise() {
    let machine = config::load("paper").expect("a machine");
    let mut once = runs(&machine, &[]);
    let mut random = Pcg64Mcg::seed_from_u64(31);
    for (run, lap_s) in once.iter_mut().zip([2.4, 1.6, 2.0]) {
        let rows = (1.05 * lap_s * ROWS_PER_S) as usize;
        run.is_sound.truncate(rows);
        let axis = run.axes.get_mut(&AxisId::X).expect("an axis");
        for column in [&mut axis.setpoint_m, &mut axis.position_m, &mut axis.current_a] {
            column.truncate(rows);
        }
        axis.table_m.as_mut().expect("a scale").truncate(rows);
        // Noise that is slow, so that single rows hardly show it.
        let mut slow_a = 0.0;
        for current_a in &mut axis.current_a {
            let drawn: f64 = StandardNormal.sample(&mut random);
            slow_a = 0.98 * slow_a + (1.0 - 0.98_f64.powi(2)).sqrt() * 8.0 * NOISE_A * drawn;
            *current_a += slow_a;
        }
    }
    let analysis = analysed(&machine, &once);
    assert!(analysis.repeats.is_empty(), "{:?}", analysis.repeats);
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    assert!(!axis.problem.is_noise_told());
    assert!(axis.named.effects.is_empty(), "{:?}", axis.named.effects);
    assert_eq!(axis.verdict, Verdict::Insufficient);
}
