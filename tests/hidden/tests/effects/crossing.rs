//! What the other axis does to one.

use super::*;

/// Where friction does not cross, only what accelerates the other table does.
#[test]
fn an_axis_may_be_crossed_by_inertia_alone() {
    let tilted = effect(What::Named(Kind::CrossCoupling), 1.0, 0.4);
    let (features, size) = set(&tilted);
    let motion = || Motion::Circle { radius: 0.02, feed: 0.2, laps: 1, is_ccw: true };
    let (with, without) = (rows(motion(), &features, 2000), rows(motion(), &Default::default(), 2000));
    let mass = machine().axes[1].plant.mass;
    let (mut missed, mut sum) = (0.0, 0.0);
    for at in 1..with.len() - 1 {
        let table = |at: usize| without[at][1].table;
        let wanted =
            size * 1e-9 * mass * (table(at + 1) - 2.0 * table(at) + table(at - 1)) / 5e-4_f64.powi(2);
        missed += (with[at][0].table - without[at][0].table - wanted).powi(2);
        sum += wanted.powi(2);
        assert_eq!(with[at][0].position, without[at][0].position);
    }
    let [missed, rms] = [missed, sum].map(|sum| (sum / (with.len() - 2) as f64).sqrt());
    assert!(rms > 1e-7 && missed < 0.2 * rms, "off by {missed:.3e} of {rms:.3e}");
}
