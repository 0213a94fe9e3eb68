//! Promise: friction that rises with the speed and a force that is always there are fitted with the base, and named beside
//! whatever else is missing, after it.

use super::*;

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_every_axis_has_a_little_of_is_named_after_what_is_missing_beside_it() {
    let machine = config::load("paper").expect("a machine");
    let added = [("backlash", 2.0), ("viscous-friction", 0.5), ("constant-force", -30.0)];
    let analysis = analysed(&machine, &runs(&machine, &added));
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    let names: Vec<&str> = axis.named.effects.iter().map(|effect| effect.name).collect();
    assert_eq!(names, added.map(|(name, _)| name));
    for (place, (name, truth)) in added.into_iter().enumerate() {
        let (_, value, [low, high]) = axis.named.model.effect(place)[0];
        assert!((value / truth - 1.0).abs() < 0.1 && low < value && value < high, "{name}: {value}");
        assert_eq!(axis.named.model.model.effects[place].entry.name, name, "in the order of the names");
    }
    // No log tells a force from friction that differs by direction.
    let members: Vec<&str> = axis.named.effects[2].members().collect();
    assert_eq!(members, ["constant-force", "direction-asymmetry"]);
    assert!(axis.named.base.model.effects.is_empty(), "the base has none of what has a name");
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_is_not_sure_stays_with_the_base_and_in_no_file() {
    let machine = config::load("paper").expect("a machine");
    let analysis = analysed(&machine, &runs(&machine, &[("backlash", 2.0)]));
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    let unnamed: Vec<&str> =
        axis.named.model.model.effects.iter().skip(1).map(|tried| tried.entry.name).collect();
    assert_eq!(unnamed, ["viscous-friction", "constant-force"]);
    let smallest = |name: &str| {
        let all = &axis.named.smallest;
        all.iter().find(|one| one.name == name).expect("of every effect").amplitude
    };
    let force_n = smallest("constant-force").expect("circles show it");
    assert!((0.1..20.0).contains(&force_n), "{force_n} N would have been seen");

    let mut file = MachineFile::create(Path::new("mill.toml"), &machine).expect("a file");
    let origin = Origin { runs: "slow".to_owned(), date: "today".to_owned(), commit: "this".to_owned() };
    assert!(write_back::put(&mut file, &machine, &analysis, &origin).expect("it has the keys"));
    let plant = file.machine().expect("a sound machine").axes[AxisId::X].plant;
    for (entry, values) in plant.effects.present() {
        let place = axis.named.model.model.effects.iter().position(|tried| tried.entry.name == entry.name);
        let (_, _, [low, high]) = axis.named.model.effect(place.expect("it was fitted"))[0];
        assert!(low * high > 0.0, "{}: {values:?}", entry.name);
    }
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn a_viscous_friction_has_a_name_beyond_what_a_file_that_has_some_may_be_wrong_by() {
    let mut machine = config::load("paper").expect("a machine");
    machine.axes[AxisId::X].plant.friction.viscous_n_s_per_m = 500.0;
    for (hidden, verdict) in [(0.4, Verdict::ParameterOnly), (1.2, Verdict::Named)] {
        let analysis = analysed(&machine, &runs(&machine, &[("viscous-friction", hidden)]));
        let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
        assert_eq!(axis.verdict, verdict, "{hidden} N s/mm");
        for named in &axis.named.effects {
            let (_, value, [low, high]) = axis.named.model.effect(0)[0];
            assert_eq!(named.name, "viscous-friction");
            assert!((value / hidden - 1.0).abs() < 0.05 && low < hidden && hidden < high, "{value}");
        }
    }
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn guides_that_give_way_over_more_than_their_file_says_are_of_the_base() {
    let mut machine = config::load("paper").expect("a machine");
    let (plant, bristles) = (&mut machine.axes[AxisId::X].plant, entry("presliding").expect("an effect"));
    *plant = plant.with_effect(bristles, [8.0, 0.0, 0.0]);
    let analysis = analysed(&machine, &runs(&machine, &[("presliding", 9.0), ("backlash", 2.0)]));
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    let names: Vec<&str> = axis.named.effects.iter().map(|effect| effect.name).collect();
    assert_eq!(names, ["backlash"]);

    let mut file = MachineFile::create(Path::new("mill.toml"), &machine).expect("a file");
    let origin = Origin { runs: "slow".to_owned(), date: "today".to_owned(), commit: "this".to_owned() };
    assert!(write_back::put(&mut file, &machine, &analysis, &origin).expect("it has the keys"));
    let plant = file.machine().expect("a sound machine").axes[AxisId::X].plant;
    let [way_um, ..] = plant.effects.of(bristles);
    assert!((way_um - 9.0).abs() < 0.2, "{way_um} um");
}
