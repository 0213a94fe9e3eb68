//! What `quadrant gap` prints of something real that has no name.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::offline::gap::locate::rest::{Rest, Shows};
use crate::offline::gap::model::problem::SIGNALS;

/// Something real that is left without a name, and how it shows.
#[derive(Debug, Default, Serialize)]
pub(super) struct Left {
    /// Which shows it.
    signal: Option<&'static str>,
    /// Over which it comes again.
    coordinate: Option<String>,
    /// How much of all that is left is a shape over it.
    share: Option<f64>,
    /// At which it sounds.
    frequency_hz: Option<f64>,
    /// After how much way it comes again.
    period_mm: Option<f64>,
    /// In how many runs it pushes at moments of its own, of how many.
    pushed_runs: Option<[usize; 2]>,
    /// In how many runs single readings jump, of how many.
    jumping_runs: Option<[usize; 2]>,
    /// How many times as much as noise every run leaves, per row.
    times_noise: Option<f64>,
    /// Without which base parameter it would show, and how many times what the file says that is.
    strained: Option<BTreeMap<&'static str, f64>>,
    /// By how much all axes are behind their commands at once, at most; ahead if it is less than zero.
    behind_us: Option<f64>,
    #[serde(skip)]
    pub(super) sentence: String,
}

impl Left {
    pub(super) fn new(rest: &Rest) -> Self {
        let mut left = Self { sentence: rest.to_string(), ..Self::default() };
        match *rest {
            Rest::Strained { parameter, ratio } => left.strained = Some([(parameter, ratio)].into()),
            Rest::Behind { by_s, .. } => left.behind_us = Some(1e6 * by_s),
            Rest::In { signal, shows } => {
                left.signal = Some(SIGNALS[signal].0);
                match shows {
                    Shows::Over(over) => left.coordinate = Some(over.to_string()),
                    Shows::Shaped(over, share) => {
                        (left.coordinate, left.share) = (Some(over.to_string()), Some(share));
                    }
                    Shows::Tone(tone_hz) => left.frequency_hz = Some(tone_hz),
                    Shows::Period(period_mm) => left.period_mm = Some(period_mm),
                    Shows::Everywhere(times) => left.times_noise = Some(times),
                    Shows::Bursts(runs) => left.pushed_runs = Some(runs),
                    Shows::Jumps(runs) => left.jumping_runs = Some(runs),
                }
            }
        }
        left
    }
}
