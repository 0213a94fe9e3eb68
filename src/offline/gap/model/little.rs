//! What every axis has a little of: a friction that changes while the runs are made, and guides that give way by tenths of a
//! micrometre before they slide. It is no effect, and stays with the base.
//!
//! Invariant: how little that is, is said here alone.

use super::problem::Problem;
use super::{FALLS, Tried};
use crate::base::units::Velocity;
use crate::plant::effects::{Values, warmed_share};
use crate::plant::friction;

/// A friction that is still on its way when the runs end, and changes by less until then, and in a second, is an axis that gets warm or
/// cold as all do.
const DRIFTS: Little = Little { at_all: 0.03, per_s: 0.02 / 60.0 };
/// The same where its way seems to end before: a friction that changes steadily explains this share of what it does. The
/// valley of a time constant is too rough for its interval to say so.
const DRIFTS_STEADILY: Little = Little { at_all: 0.02, per_s: 0.02 / 100.0 };
const STEADY: f64 = 0.75;
/// Ways over which a guide gives way that sticks, um, by law: half of what holds it is there after the same way.
const STICKS: [(&str, f64); 2] = [("presliding", 0.2), ("presliding-with-memory", 0.4)];
/// By how many times a file may have the velocity wrong at which its friction has fallen.
const FALL_OFF: f64 = 2.0;

/// A change of friction that is too little for a name, as shares of it.
struct Little {
    at_all: f64,
    per_s: f64,
}

impl Little {
    fn holds(&self, values: Values, end_s: f64) -> bool {
        warmed_share(values, end_s).abs() < self.at_all.min(self.per_s * end_s)
    }
}

/// When the last run ends.
pub(in crate::offline::gap) fn end_s(problem: &Problem<'_>) -> f64 {
    problem.spans_s().into_iter().map(|[_, end_s]| end_s).fold(0.0, f64::max)
}

/// Whether an effect is a friction that changes little until the runs end and is still on its way then. Of such a way no rows tell how
/// long it is, and bounds of its size say nothing.
pub(in crate::offline::gap) fn is_on_its_way(problem: &Problem<'_>, tried: &Tried) -> bool {
    let end_s = end_s(problem);
    is_drift(tried, tried.values[1], end_s, &|| 0.0)
}

/// Whether an effect is a guide that hardly gives way before it slides.
pub(in crate::offline::gap) fn is_stick(tried: &Tried) -> bool {
    tried.values[0] < least_with_a_name(tried.entry.name)
}

/// Whether an effect is a friction that has mostly fallen where that of the file may fall yet, which is that of the base by another shape.
pub(in crate::offline::gap) fn is_of_the_fall(tried: &Tried, law: &friction::Parameters) -> bool {
    tried.entry.name == FALLS
        && law.breakaway > law.sliding
        && Velocity::mm_per_s(tried.values[1]) < law.fall_end * FALL_OFF
}

/// The amplitude from which an effect has a name, however plain less of it is; nothing where any has.
pub(in crate::offline::gap) fn least_with_a_name(name: &str) -> f64 {
    STICKS.iter().find(|(law, _)| *law == name).map_or(f64::NEG_INFINITY, |(_, way_um)| *way_um)
}

/// Whether an effect is a friction that changes little, and may go on to after the runs end: `longest_s` is what its time
/// constant may be, and the last which share it explains where it does not settle.
pub(in crate::offline::gap) fn is_drift(
    tried: &Tried,
    longest_s: f64,
    end_s: f64,
    explains_as_steady: &dyn Fn() -> f64,
) -> bool {
    let is_on_its_way = || longest_s > end_s && DRIFTS.holds(tried.values, end_s);
    let is_steady = || DRIFTS_STEADILY.holds(tried.values, end_s) && explains_as_steady() > STEADY;
    tried.entry.name == "friction-warm-up" && (is_on_its_way() || is_steady())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn guides_that_give_way_by_tenths_of_a_micrometre_stick() {
        for (name, way_um, sticks) in [
            ("presliding", 0.11, true),
            ("presliding", 0.3, false),
            ("presliding-with-memory", 0.3, true),
            ("presliding-with-memory", 0.5, false),
            ("backlash", 0.11, false),
        ] {
            let tried = Tried { entry: entry(name).expect("an effect"), values: [way_um, 1.5, 0.0] };
            assert_eq!(is_stick(&tried), sticks, "{name} of {way_um} um");
        }
    }

    #[test]
    fn a_friction_that_falls_before_the_law_does_is_of_its_fall() {
        let law = paper_axis().friction;
        let straight = friction::Parameters { breakaway: law.sliding, ..law };
        let end_mm_per_s = law.fall_end.as_mm_per_s();
        for (name, times, law, is) in [
            ("stribeck", 1.8, law, true),
            ("stribeck", 2.2, law, false),
            ("stribeck", 0.9, straight, false),
            ("friction-warm-up", 0.9, law, false),
        ] {
            let entry = entry(name).expect("an effect");
            let tried = Tried { entry, values: [66.0, times * end_mm_per_s, 2.0] };
            assert_eq!(is_of_the_fall(&tried, &law), is, "{name}, {times} of the end of the fall");
        }
    }

    #[test]
    fn a_friction_that_changes_little_until_the_runs_end_drifts() {
        let of = |name, drop_percent, time_constant_s| Tried {
            entry: entry(name).expect("an effect"),
            values: [drop_percent, time_constant_s, 0.0],
        };
        for (drop_percent, times_s, end_s, steady, drifts) in [
            // By 1.5, 5.4 and 1 % until then.
            (25.7, [1677.0, 1677.0], 100.0, 0.0, true),
            (-25.7, [1677.0, 1677.0], 100.0, 0.0, true),
            (90.0, [1600.0, 1600.0], 100.0, 0.0, false),
            (1.0, [15.0, 40.0], 100.0, 0.5, false),
            // Nothing tells whether it has ended, by its interval and by what explains as much.
            (-2.0, [65.0, 214.0], 95.0, 0.0, true),
            (1.6, [46.0, 59.0], 100.0, 0.9, true),
            // It changes by more.
            (3.2, [59.0, 90.0], 100.0, 0.9, false),
            // By 2.4 % within five seconds.
            (25.0, [50.0, 50.0], 5.0, 0.9, false),
        ] {
            let [time_constant_s, longest_s] = times_s;
            let tried = of("friction-warm-up", drop_percent, time_constant_s);
            let found = is_drift(&tried, longest_s, end_s, &|| steady);
            assert_eq!(found, drifts, "{drop_percent} % in {times_s:?} s, of {end_s} s, {steady} if steady");
        }
        assert!(!is_drift(&of("thermal-growth", 25.0, 1677.0), 1677.0, 100.0, &|| 1.0));
    }
}
