//! Promise: a swing along screw or scale is named with its period, beside another that is as large, and where the table is
//! behind the motor by more than the period.

use quadrant::offline::gap::name::named::NamedEffect;
use quadrant::plant::effects::Values;

use super::*;

/// Name of an effect, its amplitude and its period in the units of its keys.
type Swing = (&'static str, [f64; 2]);

/// What is named of a machine with these effects and a screw of that stiffness, from circles of these radii in mm and a table scale
/// with noise, the shortest period first.
fn named(effects: &[(&str, Values)], stiffness_n_per_m: f64, radii_mm: [f64; 3], noise_m: f64) -> Vec<Swing> {
    let mut machine = config::load("paper").expect("a machine");
    machine.axes[AxisId::X].plant.mechanics.stiffness_n_per_m = stiffness_n_per_m;
    let mut plant = machine.axes[AxisId::X].plant;
    for (name, values) in effects {
        plant = plant.with_effect(entry(name).expect("an effect"), *values);
    }
    let [slow, fast, judging] = radii_mm;
    let mut runs = [("slow", slow, 2.4, 1), ("fast", fast, 1.6, 2), ("heldout", judging, 2.0, 3)]
        .map(|(name, radius_mm, lap_s, seed)| circle(&machine, &plant, name, [radius_mm, lap_s], seed, 0));
    let (mut random, noise) = (Pcg64Mcg::seed_from_u64(5), Normal::new(0.0, noise_m).expect("a width"));
    for run in &mut runs {
        let axis = run.axes.get_mut(&AxisId::X).expect("an axis");
        axis.table_m.iter_mut().flatten().for_each(|table_m| *table_m += noise.sample(&mut random));
    }
    let analysis = analysed(&machine, &runs);
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    let of = |(place, effect): (usize, &NamedEffect)| {
        let values = axis.named.model.effect(place);
        (effect.name, [values[0].1, values[1].1])
    };
    let mut named: Vec<_> = axis.named.effects.iter().enumerate().map(of).collect();
    named.sort_by(|(_, [_, a]), (_, [_, b])| a.total_cmp(b));
    named
}

/// One per cent of amplitudes and a thousandth of periods are what they may be off by.
fn is_near(found: &[Swing], wanted: &[Swing]) -> bool {
    let is = |((name, values), (other, truths)): (&Swing, &Swing)| {
        let off = |place: usize| (values[place] / truths[place] - 1.0).abs();
        name == other && off(0) < 1e-2 && off(1) < 1e-3
    };
    found.len() == wanted.len() && found.iter().zip(wanted).all(is)
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn two_swings_of_a_screw_are_named_that_bend_each_others_size() {
    let effects = [("pitch-error", [0.86, 12.7, -48.0]), ("pitch-error-harmonic", [0.82, 6.35, -56.0])];
    let found = named(&effects, 151e6, [6.0, 10.0, 8.0], 15e-9);
    assert!(is_near(&found, &[("pitch-error", [0.82, 6.35]), ("pitch-error", [0.86, 12.7])]), "{found:?}");
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn lines_of_a_scale_are_named_where_the_table_is_behind_by_more_than_one() {
    // The force of its friction winds the screw up by 25 um, one way and the other.
    let effects = [("encoder-interpolation-scale", [1.0, 33.3, 30.0])];
    let found = named(&effects, 38e6, [10.0, 20.0, 15.0], 0.1e-6);
    assert!(is_near(&found, &[("encoder-interpolation", [1.0, 33.3])]), "{found:?}");
}
