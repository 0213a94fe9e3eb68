//! The score of made-up answers to made-up cases, counted by hand.

use hidden::case::Truth;
use hidden::score::{Answer, Judged, confusion, faults, table};
use serde_json::{Value, json};

fn judged(truth: &[(&str, &str, &str)], role: &str, severity: Value, answer: Value) -> Judged {
    let effects: Vec<Value> = truth
        .iter()
        .map(|(axis, name, key)| json!({ "axis": axis, "name": name, "parameters": { *key: 2.0 }, "d_prime": 40.0 }))
        .collect();
    let truth: Truth = serde_json::from_value(json!({
        "id": "made-up", "role": role, "verdicts": [], "effects": effects, "severity": severity, "d_prime": 40.0,
        "seeds": [1, 2], "has_table": true, "absent": null, "outlier": null, "base_error": 0.1,
    }))
    .expect("a truth");
    Judged { truth, answer: serde_json::from_value::<Answer>(answer).expect("an answer") }
}

fn named(effects: &[(&str, &str)]) -> Value {
    let effects: Vec<Value> = effects
        .iter()
        .map(|(axis, name)| {
            json!({ "axis": axis, "name": name, "parameters": { "backlash-um": 2.1 },
                "interval": { "backlash-um": [1.9, 2.3] }, "confidence": 0.9, "alternatives": ["soft-zone"] })
        })
        .collect();
    json!({ "verdict": "named", "effects": effects, "gap": { "heldout_closed_fraction": 0.9 }, "seconds": 3.0 })
}

fn cases() -> Vec<Judged> {
    let backlash = [("x", "backlash", "backlash-um")];
    let verdict = |verdict: &str| json!({ "verdict": verdict, "effects": [] });
    vec![
        judged(&backlash, "single", json!("medium"), named(&[("x", "backlash")])),
        // The right name on the wrong axis.
        judged(&backlash, "single", json!("large"), named(&[("y", "backlash")])),
        // Wrong, with the truth nowhere, and in its class.
        judged(&backlash, "single", json!("medium"), named(&[("x", "presliding")])),
        judged(&[("x", "soft-zone", "h")], "single", json!("medium"), named(&[("x", "backlash")])),
        // A twin is right.
        judged(
            &[("x", "pitch-error", "h")],
            "single",
            json!("small"),
            named(&[("x", "encoder-eccentricity")]),
        ),
        judged(&[], "null", Value::Null, verdict("nothing-missing")),
        judged(&[], "null", Value::Null, named(&[("x", "stribeck")])),
        judged(&[("x", "wiper-slip", "h")], "unknown", json!("large"), verdict("unknown")),
        judged(
            &[("x", "backlash", "backlash-um"), ("y", "stribeck", "h")],
            "pair",
            json!("medium"),
            named(&[("x", "backlash"), ("x", "presliding"), ("x", "squareness")]),
        ),
        judged(&backlash, "single", json!("medium"), json!({ "verdict": "failed" })),
    ]
}

#[test]
fn the_table_counts_what_a_hand_counts() {
    let table = table(&cases());
    for (name, hits) in [
        ("first name, medium and large, with scale", "2/5"),
        ("  in a class of three at most", "3/5"),
        ("first name, small", "1/1"),
        ("axis of a right name", "2/3"),
        ("wrong name, said for sure", "2/7"),
        ("any name where nothing is missing", "1/2"),
        ("unknown effects that are called unknown", "1/1"),
        ("pairs, both right", "0/1"),
        ("pairs, one right at least", "1/1"),
        ("pairs, one too many", "1/1"),
        ("effects that are found", "4/8"),
        ("names that are right", "4/9"),
        ("parameters within their 95 % interval", "2/2"),
        ("no answer or a failure", "1/10"),
    ] {
        let line = table.lines().find(|line| line.starts_with(name)).unwrap_or_default();
        assert!(line.contains(&format!(" {hits} ")), "`{line}` should say {hits}\n{table}");
    }
    assert!(table.contains("median 5.000, p90 5.000 of 2"), "both backlashes are off by 5 %\n{table}");
    // Of seven names said with 0.9, four are right.
    assert!(table.contains("0.329"), "{table}");
}

#[test]
fn every_case_is_in_one_cell() {
    let matrix = confusion(&cases());
    let cells = matrix.lines().skip_while(|line| !line.starts_with("    ")).skip(1);
    let count: usize =
        cells.flat_map(|row| row.split_whitespace().skip(1)).filter_map(|n| n.parse::<usize>().ok()).sum();
    assert_eq!(count, cases().len(), "{matrix}");
}

#[test]
fn what_must_not_be_said_is_a_fault() {
    let found = faults(&cases(), 0.5);
    // Of six plain effects one is named right, another one on the wrong axis.
    let wanted = [
        "made-up: presliding, and sure of it",
        "made-up: backlash, and sure of it",
        "made-up: stribeck where nothing is missing",
        "made-up: no answer",
        "2 of 5 plain effects named, wanted 0.5",
    ];
    assert_eq!(found, wanted);
    let right = judged(&[("x", "backlash", "h")], "single", json!("large"), named(&[("x", "backlash")]));
    assert_eq!(faults(&[right], 1.0), [""; 0]);
}
