//! At which values an effect is tried: at half its usual size, times and places at a few or where spectra have their peaks, and what has a phase at
//! three.
//!
//! Invariant: the first trial of an effect is at its usual values.

use super::turned;
use crate::plant::effects::{Entry, Parameter, Values};

/// Share of its usual size at which an effect is tried.
const SHARE: f64 = 0.5;

/// Values that differ by less, as a share, are one: a peak where it usually is.
const SAME: f64 = 1e-6;

/// What swings with the table makes no peak where nothing excites it much: it is looked for at these frequencies, Hz, so damped, %, that each
/// reaches half way to the next.
const SWINGS: ([f64; 8], f64) = ([14.0, 19.0, 26.0, 36.0, 50.0, 70.0, 100.0, 140.0], 15.0);

/// Shares of its usual length at which a way over which an axis gives way is tried as well.
const WAYS: [f64; 4] = [3.0, 0.3, 0.1, 0.03];

/// Share of what a model leaves from which on another leaves as much.
const AS_MUCH: f64 = 0.9;

/// An effect with its values.
pub(super) type Trial = (&'static Entry, Values);

/// Trials of what swings that gained next to nothing beside a model. They are spared beside one that leaves nearly as much: what has been found since
/// hid no swing that is not its own.
#[derive(Debug, Default)]
pub(in crate::offline::gap) struct InVain {
    left: f64,
    trials: Vec<Trial>,
}

impl InVain {
    /// Those that still are beside a model that leaves so much.
    pub(in crate::offline::gap) fn beside(self, left: f64) -> Self {
        let trials = if left < AS_MUCH * self.left { Vec::new() } else { self.trials };
        Self { left, trials }
    }

    /// Whether a trial is one.
    pub(in crate::offline::gap) fn has(&self, (entry, values): &Trial) -> bool {
        self.trials.iter().any(|(other, at)| other.name == entry.name && at == values)
    }

    /// Those too.
    pub(in crate::offline::gap) fn extend(&mut self, others: impl IntoIterator<Item = Trial>) {
        self.trials.extend(others);
    }
}

/// Values at which an entry is tried, one amplitude at a time.
pub(super) fn seeds(entry: &'static Entry, peaks: &dyn Fn(&Parameter) -> Vec<f64>) -> Vec<Values> {
    let mut nominal = entry.nominal();
    nominal[0] = if nominal[0] == 0.0 { entry.parameters[0].prior } else { nominal[0] } * SHARE;
    let mut seeds = vec![nominal];
    if is_way(entry, &entry.parameters[0]) {
        let [low, high] = entry.parameters[0].bounds;
        let ways = WAYS.iter().map(|share| share * nominal[0]).filter(|way| (low..=high).contains(way));
        seeds.extend(ways.map(|way| {
            let mut other = nominal;
            other[0] = way;
            other
        }));
    }
    for place in entry.amplitudes().skip(1) {
        let mut alone = nominal;
        alone[0] = 0.0;
        alone[place] = entry.parameters[place].prior * SHARE;
        seeds.push(alone);
    }
    for (place, parameter) in
        entry.parameters.iter().enumerate().filter(|(place, _)| !entry.is_amplitude(*place))
    {
        // A damping is found by the fit.
        if parameter.unit == "deg" || parameter.key == "damping-percent" {
            continue;
        }
        let [low, high] = parameter.bounds;
        let mut others: Vec<f64> = if is_way(entry, parameter) {
            WAYS.map(|share| share * parameter.nominal).to_vec()
        } else {
            peaks(parameter)
        };
        if others.is_empty() {
            others = [0.3, 3.0].map(|factor| parameter.nominal * factor).to_vec();
        }
        let mut tried = vec![parameter.nominal];
        others.retain(|value| {
            let is_new = tried.iter().all(|other| (value / other - 1.0).abs() > SAME);
            tried.push(*value);
            is_new && (low..=high).contains(value)
        });
        let so_far = seeds.clone();
        for other in others {
            seeds.extend(so_far.iter().map(|seed| {
                let mut seed = *seed;
                seed[place] = other;
                // What comes to its end sooner goes as fast: all of it within a run would be far from straight.
                if parameter.key == "time-constant-s" {
                    seed[0] *= (other / parameter.nominal).min(1.0);
                }
                seed
            }));
        }
    }
    let place = |key: &str| entry.parameters.iter().position(|parameter| parameter.key == key);
    if let (Some(frequency), Some(damping)) = (place("frequency-hz"), place("damping-percent")) {
        seeds.extend(SWINGS.0.map(|hz| {
            let mut swinging = nominal;
            (swinging[frequency], swinging[damping]) = (hz, SWINGS.1);
            swinging
        }));
    }
    seeds
}

/// Whether it is a way over which an axis gives way: a shorter one is another shape, and not less of the same.
fn is_way(entry: &Entry, parameter: &Parameter) -> bool {
    parameter.unit == "um" && phase_of(entry).is_none()
}

pub(in crate::offline::gap) fn phase_of(entry: &Entry) -> Option<usize> {
    entry.parameters.iter().position(|parameter| parameter.unit == "deg")
}

/// The values of a trial: once, or at each of three phases; at two a quarter of a turn apart of what the table scale alone shows, which is linear, for
/// no axis moves by it.
pub(super) fn variants(entry: &Entry, values: Values) -> Vec<Values> {
    let Some(place) = phase_of(entry) else { return vec![values] };
    let phases_deg: &[f64] = if entry.is_of_table_scale() { &[0.0, 90.0] } else { &turned::PHASES_DEG };
    let at = |phase_deg: &f64| {
        let mut values = values;
        values[place] = *phase_deg;
        values
    };
    phases_deg.iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::effects::entry;

    #[test]
    fn what_swings_is_tried_near_each_frequency_of_a_machine() {
        let entry = entry("resonance").expect("an effect");
        let seeds = seeds(entry, &|_| Vec::new());
        for hz in 13..160 {
            let reaches = |[share, at_hz, damping]: &Values| {
                *share > 0.0 && (f64::from(hz) / at_hz).ln().abs() < 1.2e-2 * damping
            };
            assert!(seeds.iter().any(reaches), "{hz} Hz");
        }
    }

    #[test]
    fn a_peak_where_it_usually_is_is_tried_once() {
        let entry = entry("pitch-error").expect("an effect");
        let seeds = seeds(entry, &|_| vec![8.0, 20.0 + 1e-9, 12.7, 20.0, entry.parameters[1].nominal, 8.0]);
        let periods: Vec<f64> = seeds.iter().map(|seed| seed[1]).collect();
        assert_eq!(periods, [entry.parameters[1].nominal, 8.0, 20.0 + 1e-9, 12.7]);
    }

    #[test]
    fn what_the_table_scale_alone_shows_has_two_phases_a_quarter_of_a_turn_apart() {
        let phases = |name: &str| -> Vec<f64> {
            let entry = entry(name).expect("an effect");
            let place = phase_of(entry).expect("a phase");
            variants(entry, entry.nominal()).iter().map(|values| values[place]).collect()
        };
        assert_eq!(phases("pitch-error"), [0.0, 90.0]);
        assert_eq!(phases("encoder-eccentricity"), turned::PHASES_DEG, "loops follow their encoder");
    }

    #[test]
    fn what_was_in_vain_is_spared_until_much_less_is_left() {
        let [cogging, ripple] =
            ["motor-cogging", "torque-ripple"].map(|name| entry(name).expect("an effect"));
        let at = |order: f64| [0.05, order, 0.0];
        let mut in_vain = InVain::default().beside(100.0);
        in_vain.extend([(cogging, at(12.0))]);
        let in_vain = in_vain.beside(95.0);
        assert!(in_vain.has(&(cogging, at(12.0))));
        assert!(!in_vain.has(&(cogging, at(12.1))) && !in_vain.has(&(ripple, at(12.0))));
        assert!(!in_vain.beside(50.0).has(&(cogging, at(12.0))));
    }

    #[test]
    fn what_comes_to_its_end_sooner_is_tried_as_fast() {
        let entry = entry("friction-warm-up").expect("an effect");
        let seeds = seeds(entry, &|_| vec![33.0, 99.0, 3_600.0]);
        let per_s: Vec<f64> = seeds.iter().map(|[drop, time_constant_s, _]| drop / time_constant_s).collect();
        assert_eq!(seeds.iter().map(|seed| seed[1]).collect::<Vec<f64>>(), [1_800.0, 33.0, 99.0, 3_600.0]);
        assert!(per_s[..3].iter().all(|rate| (rate / per_s[0] - 1.0).abs() < 1e-12), "{per_s:?}");
        assert_eq!(seeds[3][0], seeds[0][0], "no more than half the usual size");
    }

    #[test]
    fn a_play_is_tried_at_many_sizes_and_an_eccentricity_at_one() {
        for (name, place, count) in
            [("backlash", 0, 5), ("presliding", 0, 5), ("soft-zone", 1, 4), ("encoder-eccentricity", 0, 1)]
        {
            let seeds = seeds(entry(name).expect("an effect"), &|_| Vec::new());
            let mut sizes: Vec<f64> =
                seeds.iter().map(|seed| seed[place]).filter(|size| *size > 0.0).collect();
            sizes.sort_by(f64::total_cmp);
            sizes.dedup();
            assert_eq!(sizes.len(), count, "{name}: {sizes:?}");
            assert!(sizes.windows(2).all(|pair| pair[1] < 4.0 * pair[0]), "{name}: {sizes:?}");
        }
    }
}
