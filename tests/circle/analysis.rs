//! Promise: a circular path of known shape gives back its known numbers.

use quadrant::base::axis::AxisId;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::record::CycleRecord;
use quadrant::base::sample::Freshness;
use quadrant::offline::circle::protrusion::{Baseline, mean_height_um};
use quadrant::offline::circle::{CircleError, CircularTest, Quadrant, Run, analyse};
use quadrant::offline::trace::Trace;

use crate::circle_model::{Model, REFERENCE, circle};

/// The top of the modelled spike is a cusp of 450 um/s: between two samples it loses up to this, um.
const CUSP_UM: f64 = 0.12;

fn trace(records: &[CycleRecord]) -> Trace {
    Trace::from_records(records).unwrap().stretch(1).unwrap()
}

/// Runs each circle with friction, and without where `has_twin`.
fn judge(model: &Model, circles: &[Circle], has_twin: bool) -> CircularTest {
    let twin = model.friction_free();
    let traces: Vec<(Trace, Option<Trace>)> = circles
        .iter()
        .map(|circle| (trace(&model.records(circle)), has_twin.then(|| trace(&twin.records(circle)))))
        .collect();
    let runs: Vec<Run<'_>> = circles
        .iter()
        .zip(&traces)
        .map(|(circle, (trace, twin))| Run { nominal: *circle, trace, friction_free: twin.as_ref() })
        .collect();
    analyse(&runs).unwrap()
}

fn close(what: &str, got: f64, expected: f64, bound: f64, unit: &str) {
    let off = (got - expected).abs();
    assert!(off <= bound, "{what}: {got} {unit}, expected {expected} ± {bound} {unit}");
}

#[test]
fn protrusions_have_their_height_angle_width_and_delay() {
    for direction in [Direction::Ccw, Direction::Cw] {
        let test = judge(&REFERENCE, &[circle(2000.0, direction, 1)], true);
        let protrusions = &test.motor.directions[0].protrusions;
        assert_eq!(protrusions.len(), 4);
        for protrusion in protrusions {
            let what = format!("{direction} {:?}", protrusion.quadrant);
            assert_eq!(protrusion.baseline, Baseline::FrictionFree);
            close(&what, protrusion.height_um, 25.0, CUSP_UM, "um height");
            close(&what, protrusion.delay_ms, 226.5, 0.5, "ms delay");
            let turned_deg = direction.sign() * (0.11_f64 * 2000.0 / 60.0 / 150.0).to_degrees();
            let expected_deg = (protrusion.quadrant.angle_deg() + turned_deg).rem_euclid(360.0);
            close(&what, protrusion.angle_deg, expected_deg, 0.02, "deg");
            // Up: the stick phase from 0.5^(1/2) on; down: 75 ms to half height.
            let width_ms = protrusion.width_ms.unwrap();
            close(&what, width_ms, 110.0 * (1.0 - 0.5_f64.sqrt()) + 74.84, 0.5, "ms width");
            let width_deg = 1e-3 * width_ms * (2000.0_f64 / 60.0 / 150.0).to_degrees();
            close(&what, protrusion.width_deg.unwrap(), width_deg, 1e-6, "deg width");
        }
        // The wind-up comes on top, and 1.4° past the pole a little of the other axis' wind-up off.
        let past_pole_rad: f64 = 0.11 * 2000.0 / 60.0 / 150.0;
        let expected_um = 31.3 * past_pole_rad.cos() - 6.3 * past_pole_rad.sin();
        let table_um = test.table.unwrap().protrusion_um;
        close("table height", table_um.max, expected_um, 0.02, "um");
    }
}

#[test]
fn each_quadrant_is_told_from_the_others() {
    let model = Model { pulse_um: [25.0, 12.0, 18.0, 7.0], wind_up_um: [0.0; 2], ..REFERENCE };
    for direction in [Direction::Ccw, Direction::Cw] {
        for start_deg in [0.0_f64, 45.0, 100.0, 270.0] {
            let nominal = Circle { start_angle_rad: start_deg.to_radians(), ..circle(2000.0, direction, 1) };
            let heights = judge(&model, &[nominal], true).motor.protrusion_um;
            for (quadrant, expected_um) in Quadrant::ALL.into_iter().zip(model.pulse_um) {
                let what = format!("{direction} from {start_deg}° {quadrant:?}");
                close(&what, heights.of_quadrant(quadrant), expected_um, CUSP_UM, "um");
            }
            close("max", heights.max, 25.0, CUSP_UM, "um");
        }
    }
}

#[test]
fn arc_and_friction_free_response_agree_at_every_feed() {
    let (cw, ccw) = (Direction::Cw, Direction::Ccw);
    for (feed, direction) in
        [(500.0, ccw), (1000.0, cw), (2000.0, ccw), (4000.0, cw), (8000.0, ccw), (8000.0, cw)]
    {
        let test = judge(&REFERENCE, &[circle(feed, direction, 1)], true);
        for point in test.points() {
            for protrusion in &point.directions[0].protrusions {
                let what =
                    format!("{} {direction} {feed} mm/min {:?}", point.point.name(), protrusion.quadrant);
                close(&what, protrusion.height_over_arc_um, protrusion.height_um, 0.1, "um");
            }
            close("radius decrease", point.radius_decrease_um, 50.0, 0.1, "um");
        }
    }
}

#[test]
fn deviations_of_a_spiked_circle_are_known() {
    let both = [circle(2000.0, Direction::Ccw, 1), circle(2000.0, Direction::Cw, 1)];
    let test = judge(&REFERENCE, &both, false);
    let motor = &test.motor;
    // Four equal spikes outward: no centre is better than the middle, the annulus is the spike.
    close("G", motor.circular_deviation_um, 25.0, CUSP_UM, "um");
    close("G(b)", motor.bidirectional_circular_deviation_um.unwrap(), 25.0, CUSP_UM, "um");
    for analysis in &motor.directions {
        let values = &analysis.values;
        close("F max", values.radial_deviation_um_max, -25.0, CUSP_UM, "um");
        close("F min", values.radial_deviation_um_min, -50.0, 0.02, "um");
        close("lag of x", values.x.lag_ms, 116.5, 0.02, "ms");
        close("lag difference", values.lag_difference_ms, 0.0, 0.001, "ms");
        close("lost motion at the motor", values.x.lost_motion_um, 0.0, 0.02, "um");
        // The spikes push the least-squares circle out: its radius is not the radius decrease.
        let least_squares_um = 150e3 - 1e3 * values.mean_radius_mm;
        assert!(least_squares_um < 49.8, "least-squares decrease {least_squares_um} um");
        close("radius decrease", values.radius_decrease_um, 50.0, 0.02, "um");
    }
    let table = test.table.as_ref().unwrap();
    for values in table.directions.iter().map(|analysis| &analysis.values) {
        close("lost motion of x", values.x.lost_motion_um, 12.6, 0.05, "um");
        close("lost motion of y", values.y.lost_motion_um, 12.6, 0.05, "um");
        // From the wound-up floor just before a reversal to the top of the spike.
        close("G at the table", values.circular_deviation_um, 31.3 + 6.3, 2.0 * CUSP_UM, "um");
    }
}

#[test]
fn one_direction_has_no_bidirectional_deviation() {
    let test = judge(&REFERENCE, &[circle(2000.0, Direction::Cw, 1)], false);
    assert_eq!(test.motor.bidirectional_circular_deviation_um, None);
    assert_eq!(test.motor.directions[0].protrusions[0].baseline, Baseline::FittedArc);
}

#[test]
fn lag_mismatch_flips_with_direction_and_widens_both_together() {
    let model = Model { lag_s: [0.1175, 0.1155], pulse_um: [0.0; 4], wind_up_um: [0.0; 2], ..REFERENCE };
    let both = [circle(2000.0, Direction::Ccw, 1), circle(2000.0, Direction::Cw, 1)];
    let motor = judge(&model, &both, false).motor;
    for analysis in &motor.directions {
        close("lag difference", analysis.values.lag_difference_ms, 2.0, 0.002, "ms");
    }
    // R w dtau / 2 sin 2θ: an oval of 2 x 33.33 um, turned by 90° in the other direction.
    let oval_um = 33_333.333 * 0.002;
    close("G of an oval", motor.circular_deviation_um, oval_um, 0.1, "um");
    close("G(b) of crossed ovals", motor.bidirectional_circular_deviation_um.unwrap(), oval_um, 0.1, "um");
}

#[test]
fn shift_scale_and_squareness_of_the_path_do_not_reach_the_heights() {
    let model =
        Model { centre_um: [4.0, -3.0], scale_mismatch_um: 10.0, lag_s: [0.1168, 0.1162], ..REFERENCE };
    let test = judge(&model, &[circle(2000.0, Direction::Ccw, 1)], true);
    let analysis = &test.motor.directions[0];
    close("centre x", analysis.values.centre_offset_x_um, 4.0, 0.1, "um");
    close("centre y", analysis.values.centre_offset_y_um, -3.0, 0.1, "um");
    close("amplitude of x", analysis.values.x.amplitude_decrease_um, 45.0, 0.05, "um");
    close("amplitude of y", analysis.values.y.amplitude_decrease_um, 55.0, 0.05, "um");
    close("radius decrease", analysis.values.radius_decrease_um, 50.0, 0.05, "um");
    for protrusion in &analysis.protrusions {
        close("height over arc", protrusion.height_over_arc_um, 25.0, 0.1, "um");
    }
}

#[test]
fn noise_and_encoder_steps_move_the_height_by_no_more_than_themselves() {
    let model = Model { quantum_um: 0.1, noise_um: 0.1, ..REFERENCE };
    let test = judge(&model, &[circle(2000.0, Direction::Ccw, 1)], false);
    close("height", test.motor.protrusion_um.max, 25.0, 0.25, "um");
    close("radius decrease", test.motor.radius_decrease_um, 50.0, 0.02, "um");
}

#[test]
fn every_revolution_is_measured() {
    let test = judge(&REFERENCE, &[circle(8000.0, Direction::Ccw, 3)], false);
    let protrusions = &test.motor.directions[0].protrusions;
    let revolutions: Vec<u32> = protrusions.iter().map(|protrusion| protrusion.revolution).collect();
    assert_eq!(revolutions, [1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3]);
    let mean_um = mean_height_um(protrusions, Quadrant::YMinus).unwrap();
    close("mean of three", mean_um, 25.0, 0.2, "um");
}

#[test]
fn missing_cycles_do_not_move_the_numbers() {
    let nominal = circle(2000.0, Direction::Ccw, 1);
    let mut records = REFERENCE.records(&nominal);
    let twin = trace(&REFERENCE.friction_free().records(&nominal));
    records.drain(20_000..20_400);
    let trace = trace(&records);
    assert_eq!(trace.missing_cycles(), 400);
    let test = analyse(&[Run { nominal, trace: &trace, friction_free: Some(&twin) }]).unwrap();
    close("height", test.motor.protrusion_um.max, 25.0, 0.01, "um");
    close("lag", test.motor.directions[0].values.x.lag_ms, 116.5, 0.02, "ms");
}

#[test]
fn stale_samples_do_not_move_the_numbers() {
    let nominal = circle(2000.0, Direction::Ccw, 1);
    let twin = trace(&REFERENCE.friction_free().records(&nominal));
    let whole = REFERENCE.records(&nominal);
    let mut records = whole.clone();
    // One axis at a time stands still for 10 ms in the records, away from the peaks.
    for (place, start) in (1_700..whole.len() - 20).step_by(4_000).enumerate() {
        let axis = [AxisId::X, AxisId::Y][place % 2];
        let mut held = records[start - 1].axes[axis].sample;
        held.freshness = Freshness::Stale;
        for record in &mut records[start..start + 20] {
            record.axes[axis].sample = held;
        }
    }
    for twin in [None, Some(&twin)] {
        let judge = |records: &[CycleRecord]| {
            let trace = trace(records);
            analyse(&[Run { nominal, trace: &trace, friction_free: twin }]).unwrap()
        };
        let (fresh, stale) = (judge(&whole), judge(&records));
        let held = records.iter().flat_map(|record| record.axes.as_slice());
        let held = held.filter(|axis| axis.sample.freshness == Freshness::Stale).count() as u64;
        assert!(held > 200, "{held} samples");
        assert_eq!((fresh.stale_samples, stale.stale_samples), (0, held));
        for (fresh, stale) in fresh.points().zip(stale.points()) {
            let name = fresh.point.name();
            let same = |what: &str, got: f64, expected: f64| {
                close(&format!("{what}, {name}"), got, expected, 0.01, "um");
            };
            same("radius decrease", stale.radius_decrease_um, fresh.radius_decrease_um);
            same("G", stale.circular_deviation_um, fresh.circular_deviation_um);
            let (fresh, stale) = (&fresh.directions[0], &stale.directions[0]);
            assert!(stale.values.samples < fresh.values.samples);
            same("F max", stale.values.radial_deviation_um_max, fresh.values.radial_deviation_um_max);
            same("F min", stale.values.radial_deviation_um_min, fresh.values.radial_deviation_um_min);
            same("lost motion", stale.values.x.lost_motion_um, fresh.values.x.lost_motion_um);
            assert_eq!(stale.protrusions.len(), fresh.protrusions.len());
            for (stale, fresh) in stale.protrusions.iter().zip(&fresh.protrusions) {
                same("height", stale.height_um, fresh.height_um);
                same("height over the arc", stale.height_over_arc_um, fresh.height_over_arc_um);
                same("undershoot", stale.undershoot_um, fresh.undershoot_um);
                close("peak", stale.angle_deg, fresh.angle_deg, 1e-9, "deg");
            }
        }
    }
}

#[test]
fn a_path_that_broke_off_is_refused_with_its_angle() {
    let nominal = circle(2000.0, Direction::Cw, 1);
    let records = REFERENCE.records(&nominal);
    let broken = trace(&records[..records.len() / 2]);
    let refused = analyse(&[Run { nominal, trace: &broken, friction_free: None }]).unwrap_err();
    assert!(matches!(refused, CircleError::Incomplete { .. }), "{refused:?}");
    assert_eq!(refused.to_string(), "cw: the measured part covers 180.0 degrees, expected 360");
}

#[test]
fn results_serialise_under_their_documented_names() {
    let both = [circle(8000.0, Direction::Ccw, 1), circle(8000.0, Direction::Cw, 1)];
    let json = serde_json::to_value(judge(&REFERENCE, &both, true)).unwrap();
    for key in ["max", "x_plus", "y_plus", "x_minus", "y_minus"] {
        assert!(json["motor"]["protrusion_um"][key].is_f64(), "motor.protrusion_um.{key}");
        assert!(json["table"]["protrusion_um"][key].is_f64(), "table.protrusion_um.{key}");
    }
    assert!(json["motor"]["bidirectional_circular_deviation_um"].is_f64());
    assert_eq!(json["motor"]["directions"][1]["direction"], "cw");
    assert!(json["motor"]["directions"][0]["circular_deviation_um"].is_f64());
}

#[test]
fn a_run_that_comes_to_rest_later_than_its_twin_is_judged_all_the_same() {
    let nominal = circle(2000.0, Direction::Cw, 1);
    let whole = trace(&REFERENCE.friction_free().records(&nominal));
    let last = whole.is_measured.iter().rposition(|is| *is).unwrap();
    let records = REFERENCE.friction_free().records(&nominal);
    let short = trace(&records[..=last]);
    let run = trace(&REFERENCE.records(&nominal));
    let judge = |twin: &Trace| analyse(&[Run { nominal, trace: &run, friction_free: Some(twin) }]).unwrap();
    let (with_whole, with_short) = (judge(&whole), judge(&short));
    assert_eq!(with_whole.motor.protrusion_um.max, with_short.motor.protrusion_um.max);
    assert!(with_short.motor.protrusion_um.max > 20.0);
}
