//! Pre-sliding as a bank of springs that slip one after the other: each carries the same share of the friction and
//! gives way after a travel of its own, so the force rises in a curve, returns in a loop, and a small loop within a
//! large one closes. The travels are spread evenly from an eighth to fifteen eighths of the mean.
//! Invariant: the force of the bank never passes the friction of the sliding table.

/// How many springs.
const COUNT: usize = 8;

/// The springs and how far each is bent, as share of its limit.
#[derive(Clone, Debug)]
pub struct Elements {
    mean_travel: f64,
    bent: [f64; COUNT],
}

impl Elements {
    /// Relaxed; without a travel there are none.
    pub fn new(mean_travel: f64) -> Self {
        Self { mean_travel, bent: [0.0; COUNT] }
    }

    /// Whether there are any.
    pub fn are_there(&self) -> bool {
        self.mean_travel > 0.0
    }

    /// Mean of their forces as share of their limits, `travelled` after they were followed last.
    #[inline]
    pub fn share(&self, travelled: f64) -> f64 {
        (0..COUNT).map(|n| self.after(n, travelled)).sum::<f64>() / COUNT as f64
    }

    /// Stiffness of those that do not slip, per share of the whole force: 1/m.
    #[inline]
    pub fn stiffness(&self, travelled: f64) -> f64 {
        let holds = |n: &usize| self.after(*n, travelled).abs() < 1.0;
        (0..COUNT).filter(holds).map(|n| 1.0 / self.travel(n)).sum::<f64>() / COUNT as f64
    }

    /// They have moved on.
    pub fn follow(&mut self, travelled: f64) {
        for n in 0..COUNT {
            self.bent[n] = self.after(n, travelled);
        }
    }

    fn travel(&self, n: usize) -> f64 {
        self.mean_travel * (2 * n + 1) as f64 / COUNT as f64
    }

    fn after(&self, n: usize, travelled: f64) -> f64 {
        (self.bent[n] + travelled / self.travel(n)).clamp(-1.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_loop_closes_within_a_large_one() {
        let mut elements = Elements::new(5e-6);
        elements.follow(4e-6);
        let before = elements.clone();
        elements.follow(-2e-6);
        elements.follow(2e-6);
        for (after, before) in elements.bent.iter().zip(before.bent) {
            assert!((after - before).abs() < 1e-12, "{after} came back, was {before}");
        }
        elements.follow(-20e-6);
        assert_eq!(elements.share(0.0), -1.0);
    }
}
