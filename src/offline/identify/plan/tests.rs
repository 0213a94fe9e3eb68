//! What is planned for the embedded machines, and for some that are smaller.

use super::*;
use crate::config;
use crate::rt::control::AxisLoop;

fn reference(edits: &[(&str, &str)]) -> Machine {
    let (_, text) = config::EMBEDDED[0];
    let text = edits.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "no line `{from}`");
        text.replace(from, to)
    });
    config::from_texts("reference", &text, &BTreeMap::new())
        .unwrap_or_else(|problems| panic!("{}", problems.render(false)))
}

fn plan(machine: &Machine, axes: &[AxisId]) -> Plan {
    let request = Request { gains: "standard".to_owned(), axes: axes.to_vec() };
    Plan::of(machine, &request).unwrap()
}

/// Nothing leaves the travel, and no command passes a limit.
fn assert_within(machine: &Machine, plan: &Plan) {
    for (id, axis) in machine.axes.iter() {
        let limits = &axis.control.limits;
        let (low, high) = plan.reach(id);
        let (least, most) =
            (limits.travel_min + limits.travel_margin, limits.travel_max - limits.travel_margin);
        let slack = Position::um(1e-6);
        assert!(
            low >= least - slack && high <= most + slack,
            "axis {id}: {low} to {high}, of {least} to {most}"
        );
    }
    for planned in &plan.steps {
        let limits = planned.axis.map_or(&machine.axes[AxisId::X], |axis| &machine.axes[axis]).control.limits;
        assert!(planned.top_speed <= limits.velocity * 0.8 + Velocity::mm_per_s(1e-9), "{planned:?}");
        if let Step::Line(way) | Step::Excited { way, .. } = planned.step {
            assert!(way.acceleration <= limits.acceleration, "{planned:?}");
        }
    }
}

#[test]
fn every_embedded_machine_is_asked_everything() {
    for (name, _) in config::EMBEDDED {
        let machine = config::load(name).unwrap();
        let plan = plan(&machine, &[]);
        assert_within(&machine, &plan);
        assert_eq!(plan.left_out, Vec::<String>::new(), "{name}");
        let purposes: Vec<Purpose> = plan.summary().into_keys().collect();
        assert_eq!(purposes.len(), 6, "{name}: {purposes:?}");
        let motions = plan.steps.iter().filter(|planned| planned.step.is_motion()).count();
        assert_eq!(
            plan.motions().keys().copied().collect::<Vec<_>>(),
            (1..=motions as u32).collect::<Vec<_>>()
        );
        let minutes = plan.duration_s() / 60.0;
        assert!((5.0..20.0).contains(&minutes), "{name}: {minutes} min");
    }
}

#[test]
fn an_excitation_is_one_that_the_axis_admits() {
    for (name, _) in config::EMBEDDED {
        let machine = config::load(name).unwrap();
        let plan = plan(&machine, &[]);
        let mut excited = 0;
        for planned in &plan.steps {
            let Step::Excited { way, excitation } = planned.step else { continue };
            let axis = AxisLoop::new(&machine.axes[excitation.axis].control);
            let line = crate::base::order::LineMotion {
                target: machine.axes.map(|axis, _| way.target[axis.index()].unwrap_or_default()),
                feed: way.feed,
                acceleration: way.acceleration,
            };
            assert!(
                axis.admits(&crate::base::order::ExcitedMotion { line, excitation }),
                "{name}: {planned:?}"
            );
            assert!(excitation.amplitude > Velocity::mm_per_s(0.1), "{name}: {:?}", excitation.amplitude);
            excited += 1;
        }
        assert_eq!(excited, 4, "{name}: each axis each way");
    }
}

#[test]
fn what_a_small_machine_has_no_room_for_is_left_out_aloud() {
    let small = [
        ("travel-min-mm = -250.0", "travel-min-mm = -2.0"),
        ("travel-max-mm = 250.0", "travel-max-mm = 8.0"),
        ("travel-margin-mm = 5.0", "travel-margin-mm = 1.0"),
    ];
    let machine = reference(&small);
    let plan = plan(&machine, &[]);
    assert_within(&machine, &plan);
    let said = plan.left_out.join("\n");
    assert!(said.contains("axis x: no frequency response"), "{said}");
    assert!(said.contains("axis y: no steady run at 200 mm/s"), "{said}");
    assert!(plan.summary().contains_key(&Purpose::BreakAway));
    let circle = plan.steps.iter().find_map(|planned| match planned.step {
        Step::Circle(motion) => Some(motion.circle.radius.as_mm()),
        Step::Line(_) | Step::Excited { .. } | Step::Dwell { .. } => None,
    });
    assert!(circle.is_some_and(|mm| (mm - 4.0).abs() < 1e-9), "half of 8 mm, not {circle:?}");
}

#[test]
fn one_axis_reverses_by_itself_and_the_other_stays() {
    let machine = reference(&[]);
    let plan = plan(&machine, &[AxisId::Y]);
    assert_within(&machine, &plan);
    assert_eq!(plan.reach(AxisId::X), (Position::ZERO, Position::ZERO));
    assert!(plan.steps.iter().all(|planned| planned.axis == Some(AxisId::Y)));
    assert_eq!(plan.summary()[&Purpose::Reversal].motions, 6);
}

#[test]
fn a_gain_set_that_is_not_there_is_named() {
    let request = Request { gains: "stiff".to_owned(), axes: Vec::new() };
    let said = Plan::of(&reference(&[]), &request).unwrap_err().to_string();
    assert!(said.contains("\"stiff\" is not in the machine file; it has standard, optimal"), "{said}");
}
