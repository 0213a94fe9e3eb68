//! Promise: a name beside which the machine is none that its file could mean is withdrawn.

use super::*;

use quadrant::offline::gap::locate::rest::Rest;

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn a_name_beside_a_table_of_a_fifth_of_its_mass_is_withdrawn() {
    let machine = config::load("paper").expect("a machine");
    let runs = runs(&machine, &[("backlash", 2.0)]);
    let mut file = machine.clone();
    file.axes[AxisId::X].plant.mechanics.mass_kg *= 5.0;
    let analysis = analysed(&file, &runs);
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    assert_eq!(axis.verdict, Verdict::Unknown);
    assert!(axis.named.effects.is_empty());
    let Some(Rest::Strained { parameter: "mass", ratio }) = axis.rest else {
        panic!("{:?} is left", axis.rest);
    };
    assert!((ratio / (1.1 / 5.0) - 1.0).abs() < 0.1, "{ratio} times that of the file");
    let refused: Vec<&str> = axis.named.refused.iter().map(|candidate| candidate.name()).collect();
    assert!(refused.contains(&"backlash"), "{refused:?}");
}
