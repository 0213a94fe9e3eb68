//! What an axis may be beside what it is taken for: mass, friction and stiffness off by up to a share.
//!
//! Invariant: the same share, number and seed give the same plants.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::plant::Parameters;

/// Other plants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spread {
    /// None.
    Nominal,
    /// Mass, friction and stiffness at either end, all eight together.
    Corners {
        /// Largest share that each is off.
        share: f64,
    },
    /// So many by chance, evenly between the ends.
    Random {
        /// Largest share that each is off.
        share: f64,
        /// How many.
        plants: usize,
        /// Of chance.
        seed: u64,
    },
}

impl Spread {
    /// The plants around one.
    pub fn plants(&self, nominal: &Parameters) -> Vec<Parameters> {
        match *self {
            Self::Nominal => Vec::new(),
            Self::Corners { share } => {
                let end =
                    |corner: u8, bit: u8| if corner >> bit & 1 == 0 { 1.0 - share } else { 1.0 + share };
                (0..8).map(|corner| off(nominal, [0, 1, 2].map(|bit| end(corner, bit)))).collect()
            }
            Self::Random { share, plants, seed } => {
                let mut random = Pcg64Mcg::seed_from_u64(seed);
                let mut factor = || 1.0 + share * (2.0 * random.random::<f64>() - 1.0);
                (0..plants).map(|_| off(nominal, [factor(), factor(), factor()])).collect()
            }
        }
    }
}

fn off(nominal: &Parameters, [mass, friction, stiffness]: [f64; 3]) -> Parameters {
    let mut plant = *nominal;
    plant.mechanics.mass_kg *= mass;
    plant.friction = plant.friction.scaled(friction);
    plant.mechanics.stiffness_n_per_m *= stiffness;
    plant
}
