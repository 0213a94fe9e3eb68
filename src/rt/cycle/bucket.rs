//! A leaky bucket: occasional misses drain away, a run of them overflows.
//!
//! Invariant: counts only, so it behaves the same in virtual time and on a machine.

/// When misses become a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BucketLimit {
    /// Misses that fit.
    pub misses_max: u32,
    /// Cycles in which one miss drains away.
    pub drain_cycles: u32,
}

/// Misses collected so far.
#[derive(Clone, Copy, Debug)]
pub struct Bucket {
    full: u64,
    drain_cycles: u64,
    level: u64,
}

impl Bucket {
    /// An empty bucket.
    pub const fn new(limit: BucketLimit) -> Self {
        let drain_cycles = limit.drain_cycles as u64;
        Self { full: limit.misses_max as u64 * drain_cycles, drain_cycles, level: 0 }
    }

    /// One cycle with so many misses; whether the bucket runs over.
    pub fn cycle(&mut self, misses: u64) -> bool {
        // The level counts drained cycles, so that no division is needed.
        let poured = self.level.saturating_sub(1).saturating_add(misses.saturating_mul(self.drain_cycles));
        let runs_over = poured > self.full;
        // Emptied, so that what follows is judged by itself, a stop for example.
        self.level = if runs_over { 0 } else { poured };
        runs_over
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_misses_drain_and_a_burst_overflows() {
        let limit = BucketLimit { misses_max: 3, drain_cycles: 100 };
        let mut bucket = Bucket::new(limit);
        for cycle in 0..10_000 {
            assert!(!bucket.cycle(u64::from(cycle % 101 == 0)), "one miss in 101 cycles is bearable");
        }
        let mut bucket = Bucket::new(limit);
        assert!(!bucket.cycle(3));
        assert!(bucket.cycle(1));
    }

    #[test]
    fn a_bucket_that_ran_over_is_empty() {
        let mut bucket = Bucket::new(BucketLimit { misses_max: 3, drain_cycles: 100 });
        assert!(bucket.cycle(1_000_000_000));
        assert!(!bucket.cycle(3));
        assert!(bucket.cycle(1));
    }
}
