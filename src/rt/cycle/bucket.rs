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
    limit: BucketLimit,
    level: u64,
}

impl Bucket {
    /// An empty bucket.
    pub const fn new(limit: BucketLimit) -> Self {
        Self { limit, level: 0 }
    }

    /// One cycle with so many misses; whether the bucket runs over.
    pub fn cycle(&mut self, misses: u64) -> bool {
        // The level counts drained cycles, so that no division is needed.
        self.level = self.level.saturating_sub(1) + misses * u64::from(self.limit.drain_cycles);
        self.level > u64::from(self.limit.misses_max) * u64::from(self.limit.drain_cycles)
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
}
