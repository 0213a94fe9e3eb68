//! Promise: what grows with time is found in files that each begin at zero, whether they are of one session or each of its own.

use super::*;

/// Circles of an axis whose friction falls by 25 % with 50 s, each from zero on: one after the other, or each from cold.
fn circles(machine: &Machine, is_of_one_session: bool) -> Vec<Run> {
    let mut plant = machine.axes[AxisId::X].plant;
    plant.mechanics.mass_kg *= 1.1;
    plant.friction = plant.friction.scaled(1.05);
    plant = plant.with_effect(entry("friction-warm-up").expect("an effect"), [25.0, 50.0, 0.0]);
    let mut begins_s = 0.0;
    let mut random = Pcg64Mcg::seed_from_u64(17);
    let shapes = [("slow", [10.0, 2.4]), ("fast", [20.0, 1.6]), ("heldout", [15.0, 2.0])];
    // The same circles come again when the axis is warmer.
    let again = shapes.iter().chain(&shapes).chain(&shapes).enumerate();
    again
        .map(|(number, (name, shape))| {
            let mut run = circle(machine, &plant, &format!("{name}-{number}"), *shape, 0, 0);
            if is_of_one_session {
                run.start_s = begins_s;
                begins_s += run.duration_s();
            }
            let axis = recorded(machine, &run, (AxisId::X, &plant), 0, &mut random);
            run.axes.insert(AxisId::X, axis);
            run.start_s = 0.0;
            run
        })
        .collect()
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn friction_that_warms_up_is_named_whatever_files_say_of_the_time() {
    let machine = config::load("paper").expect("a machine");
    for is_of_one_session in [true, false] {
        let analysis = analysed(&machine, &circles(&machine, is_of_one_session));
        let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
        let names: Vec<&str> = axis.named.effects.iter().map(|effect| effect.name).collect();
        assert_eq!(names, ["friction-warm-up"], "of one session: {is_of_one_session}");
        assert_eq!(axis.named.clocks_behind_s.is_some(), is_of_one_session);
        let values = axis.named.model.effect(0);
        let [drop_percent, constant_s] = [values[0].1, values[1].1];
        // Of each by itself a few seconds tell how fast friction falls, and not how far.
        let (early, wanted) = (drop_percent / constant_s, 25.0 / 50.0);
        assert!((early / wanted - 1.0).abs() < 0.1, "{early} % per s, {wanted} hidden");
    }
}
