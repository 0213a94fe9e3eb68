//! Shared by the benches that time whole pieces of work: the fastest of some runs, for others share the machine.

use std::time::Instant;

const RUNS: usize = 5;

/// How long work takes, s.
pub(crate) fn fastest_s(mut work: impl FnMut()) -> f64 {
    let seconds = (0..RUNS).map(|_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    });
    seconds.fold(f64::INFINITY, f64::min)
}
