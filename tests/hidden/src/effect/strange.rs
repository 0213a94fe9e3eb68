//! Effects that no catalogue has: whoever meets them should say that something is missing, and not give it a name.
//! Invariant: none of them is a named effect under another name.

use std::f64::consts::TAU;

use super::{Keys, Shape, friction_torque};
use crate::features::Features;
use crate::plant::Plant;

/// Kinds of effect without a name in any catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strangeness {
    /// The scale's head has play: hysteresis of the table reading alone.
    LooseHead,
    /// A cover that sticks, is dragged and snaps.
    WiperSlip,
    /// Something rolls over a rough spot.
    BearingDefect,
    /// A tool is in the cut in one half of the travel.
    CuttingForce,
    /// A cable chain that must be bent over again at each reversal.
    CableChain,
    /// Somebody turns the override knob in one of the circles.
    FeedOverride,
    /// Teeth of a belt mesh.
    BeltTeeth,
    /// Magnets of a linear motor hold.
    MagneticDetent,
}

impl Strangeness {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::LooseHead,
        Self::WiperSlip,
        Self::BearingDefect,
        Self::CuttingForce,
        Self::CableChain,
        Self::FeedOverride,
        Self::BeltTeeth,
        Self::MagneticDetent,
    ];

    /// What the truth calls it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LooseHead => "loose-scale-head",
            Self::WiperSlip => "wiper-slip",
            Self::BearingDefect => "bearing-defect",
            Self::CuttingForce => "cutting-force",
            Self::CableChain => "cable-chain",
            Self::FeedOverride => "feed-override",
            Self::BeltTeeth => "belt-teeth",
            Self::MagneticDetent => "magnetic-detent",
        }
    }

    /// Sets its numbers and says them.
    pub(super) fn set(
        self,
        size: f64,
        shape: &Shape,
        axis: usize,
        plant: &Plant,
        features: &mut [Features; 2],
        keys: &mut Keys,
    ) {
        let strange = &mut features[axis].strange;
        match self {
            Self::LooseHead => {
                strange.loose_head = size * 4e-6;
                keys.add("play-um", size * 4.0);
            }
            Self::WiperSlip => {
                let force = size * 0.15 * plant.sliding;
                let travel = shape.between(0, 0.2e-3, 2e-3);
                strange.wiper = [force / travel, force];
                keys.add("force-n", force);
                keys.add("travel-mm", travel * 1e3);
            }
            Self::BearingDefect => {
                let order = 2.37 + 4.0 * shape.choices[0];
                strange.hits = [size * 0.3 * friction_torque(plant), TAU / order, 0.1];
                keys.add("torque-nm", strange.hits[0]);
                keys.add("order", order);
            }
            Self::CuttingForce => {
                let hz = shape.between(0, 40.0, 200.0);
                strange.cut = [size * 0.3 * plant.sliding, hz];
                keys.add("force-n", strange.cut[0]);
                keys.add("frequency-hz", hz);
            }
            Self::CableChain => {
                strange.chain = [size * 0.3 * plant.sliding, shape.between(0, 4e-3, 15e-3)];
                keys.add("force-n", strange.chain[0]);
                keys.add("travel-mm", strange.chain[1] * 1e3);
            }
            Self::FeedOverride => {
                // Both axes: it is the path that slows down. Every run is longer than this.
                let (share, from) = (size * 0.05, 1.0 + shape.choices[0]);
                for features in features.iter_mut() {
                    features.strange.override_dip = [share, from, from + 0.8];
                }
                keys.add("share-percent", share * 100.0);
                keys.add("from-s", from);
            }
            Self::BeltTeeth => {
                let teeth = 13.0 + (20.0 * shape.choices[0]).round() + 0.41;
                strange.teeth = [size * 0.1 * friction_torque(plant), teeth];
                keys.add("torque-nm", strange.teeth[0]);
                keys.add("order", teeth);
            }
            Self::MagneticDetent => {
                let distance = shape.between(0, 12e-3, 24e-3);
                strange.magnets = [size * 0.3 * plant.sliding, distance, distance / 8.0];
                keys.add("force-n", strange.magnets[0]);
                keys.add("distance-mm", distance * 1e3);
            }
        }
    }
}
