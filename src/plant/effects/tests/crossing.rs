//! What the next axis does to one.

use super::*;
use crate::plant::effects::Neighbour;

#[test]
fn the_next_axis_pushes_the_table_with_its_share() {
    // By the force of its screw, and by what of that accelerates its table.
    for (name, of_screw) in [("cross-coupling-push", true), ("cross-coupling-push-of-inertia", false)] {
        let axis = paper_axis().with_effect(entry(name).expect("an effect"), [2.0, 0.0, 0.0]);
        // Gained in 20 ms under the current that keeps the speed, where the next axis pulls with so much.
        let gained_m_per_s = |force_n: f64| {
            let mut plant = Plant::sliding(&axis, TICK, Velocity::mm_per_s(10.0), Position::ZERO);
            let current = plant.state().current;
            let [this, other] = [force_n, -7.0 * force_n].map(Newtons::n);
            let [force, accelerating] = if of_screw { [this, other] } else { [other, this] };
            let next = Neighbour { table: Position::ZERO, force, accelerating };
            for _ in 0..40 {
                assert_eq!(plant.crossed(&next), Position::ZERO);
                plant.step(current);
            }
            plant.state().table_velocity.as_m_per_s() - 0.01
        };
        let mass_kg = axis.mechanics.mass_kg + axis.mechanics.motor_mass_kg();
        let expected = 0.02 * 1000.0 * 0.02 / mass_kg;
        for (force_n, expected) in [(1000.0, expected), (-1000.0, -expected), (0.0, 0.0)] {
            let gained = gained_m_per_s(force_n);
            // The screw still swings by its deflection.
            assert!(
                (gained - expected).abs() < 0.1 * expected.abs() + 1e-9,
                "{name}: {gained}, expected {expected}"
            );
        }
    }
}

#[test]
fn an_axis_gives_way_to_what_the_screw_of_the_next_one_carries_or_to_what_accelerates_its_table() {
    let mut next = Plant::sliding(&paper_axis(), TICK, Velocity::mm_per_s(10.0), Position::ZERO);
    let (mass_kg, current) = (paper_axis().mechanics.mass_kg, next.state().current);
    let shown_um = |name: &str, next: &Plant| {
        let axis = paper_axis().with_effect(entry(name).expect("an effect"), [4.0, 0.0, 0.0]);
        Plant::new(&axis, TICK).crossed(&next.neighbour(Position::ZERO)).as_um()
    };
    let both_um =
        |next: &Plant| ["cross-coupling", "cross-coupling-of-inertia"].map(|name| shown_um(name, next));
    // At rest with itself the screw carries 951.3 N of friction, and nothing accelerates.
    let [of_screw, of_inertia] = both_um(&next);
    assert!((of_screw - 4.0 * 0.9513).abs() < 1e-3 && of_inertia.abs() < 1e-9, "{of_screw}, {of_inertia}");
    for _ in 0..200 {
        next.step(current + Current::a(0.5));
    }
    let before = next.state().table_velocity;
    next.step(current + Current::a(0.5));
    let gained_m_per_s = (next.state().table_velocity - before).as_m_per_s();
    let accelerating_n = mass_kg * gained_m_per_s / TICK.as_s();
    let [of_screw, of_inertia] = both_um(&next);
    assert!(accelerating_n > 20.0, "{accelerating_n}");
    assert!((of_inertia - 4e-3 * accelerating_n).abs() < 1e-9, "{of_inertia} um of {accelerating_n} N");
    let rest_um = of_screw - of_inertia;
    assert!((rest_um - 4.0 * 0.9513).abs() < 0.05, "{rest_um} um beside");
}
