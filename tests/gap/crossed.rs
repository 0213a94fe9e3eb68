//! Promise: an effect that the rows that judge cannot show is judged by each command from what the others say of it.

use quadrant::offline::gap::gates::crossed;

use super::*;

/// Whether circles of these radii foretell a screw ripple from each other, of which each has so much, %.
fn foretold(circles: [(f64, f64); 3]) -> bool {
    let machine = config::load("paper").expect("a machine");
    let file = machine.axes[AxisId::X].plant;
    let ripple = entry("screw-ripple").expect("an effect");
    let runs = [0, 1, 2].map(|number| {
        let (radius_mm, share_percent) = circles[number];
        let plant = file.with_effect(ripple, [share_percent, 1.0, 40.0]);
        let lap_s = 2.4 - 0.4 * number as f64;
        circle(&machine, &plant, ["slow", "middle", "fast"][number], [radius_mm, lap_s], number as u64, 0)
    });
    let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0; 3]);
    let begun = Model::new(file).with(Tried { entry: ripple, values: [0.25, 1.0, 40.0] });
    let fitted = fit(&problem, &begun, Effort::Coarse(3), None);
    crossed::foretold(&problem, &fitted, &[begun.first_coordinate(0)], &[]).is_some()
}

#[test]
fn a_command_judges_what_the_others_say() {
    assert!(foretold([(10.0, 0.25), (15.0, 0.25), (20.0, 0.25)]), "all of them have it");
    assert!(!foretold([(10.0, -0.2), (15.0, 0.5), (20.0, 0.3)]), "one of them has it the other way around");
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_wide_motions_show_is_named_though_small_circles_judge() {
    let machine = config::load("paper").expect("a machine");
    let entry = entry("scale-error").expect("an effect");
    let plant = machine.axes[AxisId::X].plant.with_effect(entry, [1.5, 0.0, 0.0]);
    // What an encoder does not resolve is 2 nm at least, and 1.5 um/m are less on the circle that judges.
    let runs = [("slow", 10.0, 2.4, 1), ("fast", 20.0, 1.6, 2), ("heldout", 0.6, 2.0, 3)]
        .map(|(name, radius_mm, lap_s, seed)| circle(&machine, &plant, name, [radius_mm, lap_s], seed, 0));
    let analysis = analysed(&machine, &runs);
    let named = &analysis.axes[0].named;
    let names: Vec<&str> = named.effects.iter().map(|effect| effect.name).collect();
    assert_eq!(names, ["scale-error"]);
    let (_, error_um_per_m, _) = named.model.effect(0)[0];
    assert!((error_um_per_m - 1.5).abs() < 0.1, "{error_um_per_m} um/m");
}
