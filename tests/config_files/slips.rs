//! Random slips of the hand in the reference file, and random texts: whatever is read is judged.

use proptest::prelude::*;
use quadrant::base::time::Moment;
use quadrant::config;
use quadrant::offline::check::MachineReport;

use super::REFERENCE;

/// A change to a line of a text, as a slip of the hand or a broken disk would make it.
#[derive(Clone, Debug)]
enum Slip {
    Delete(usize),
    Repeat(usize),
    Swap(usize, usize),
    Replace(usize, String),
    Value(usize, String),
    Bytes(usize, Vec<u8>),
    Cut(usize),
}

fn slip() -> impl Strategy<Value = Slip> {
    let line = || 0..400_usize;
    let value = prop_oneof![
        any::<f64>().prop_map(|number| format!("{number:e}")),
        any::<i64>().prop_map(|number| number.to_string()),
        (-3..4_i32, 1..100_u32)
            .prop_map(|(power, digits)| format!("{}", f64::from(digits) * 10f64.powi(power))),
        (0..2000_u32).prop_map(|number| number.to_string()),
        proptest::sample::select(vec![
            "nan",
            "-inf",
            "\"\"",
            "[]",
            "{}",
            "true",
            "0",
            "1979-05-27",
            "'along'"
        ])
        .prop_map(str::to_owned),
    ];
    prop_oneof![
        1 => line().prop_map(Slip::Delete),
        1 => line().prop_map(Slip::Repeat),
        1 => (line(), line()).prop_map(|(one, other)| Slip::Swap(one, other)),
        1 => (line(), ".{0,30}").prop_map(|(at, text)| Slip::Replace(at, text)),
        6 => (line(), value).prop_map(|(at, value)| Slip::Value(at, value)),
        1 => (0..8000_usize, proptest::collection::vec(any::<u8>(), 1..6))
            .prop_map(|(at, bytes)| Slip::Bytes(at, bytes)),
        1 => (0..8000_usize).prop_map(Slip::Cut),
    ]
}

fn slipped(text: &str, slip: &Slip) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let count = lines.len().max(1);
    if lines.is_empty() {
        return text.to_owned();
    }
    match slip {
        Slip::Delete(at) => drop(lines.remove(at % count)),
        Slip::Repeat(at) => lines.insert(at % count, lines[at % count].clone()),
        Slip::Swap(one, other) => lines.swap(one % count, other % count),
        Slip::Replace(at, text) => lines[at % count].clone_from(text),
        Slip::Value(at, value) => {
            let line = &mut lines[at % count];
            if let Some((key, _)) = line.split_once('=') {
                *line = format!("{key}= {value}");
            }
        }
        Slip::Bytes(at, bytes) => {
            let mut all = text.as_bytes().to_vec();
            let at = at % (all.len() + 1);
            all.splice(at..at, bytes.iter().copied());
            return String::from_utf8_lossy(&all).into_owned();
        }
        Slip::Cut(at) => {
            return String::from_utf8_lossy(&text.as_bytes()[..at % (text.len() + 1)]).into_owned();
        }
    }
    lines.join("\n")
}

/// Whatever is read: problems that can be shown at their places, or a machine that can be built.
fn assert_is_judged(text: &str) {
    match config::from_texts("slipped.toml", text, &Default::default()) {
        Err(said) => {
            assert!(!said.problems.is_empty());
            assert!(said.problems.is_sorted_by_key(|problem| problem.span.start), "{said}");
            for problem in &said.problems {
                assert!(text.get(problem.span.clone()).is_some(), "{problem:?} is not a place in the text");
            }
            assert!(!said.render(true).is_empty() && !said.render(false).is_empty());
        }
        Ok(machine) => {
            machine.drives().unwrap_or_else(|error| panic!("{error}"));
            machine.rack(1);
            machine.live_rack(1, Moment::ZERO);
            let report = MachineReport::of(&machine);
            assert!(report.cycle.bus_load_percent <= 90.0, "{report:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 250, ..ProptestConfig::default() })]

    #[test]
    fn no_slip_of_the_hand_makes_the_reader_panic(slips in proptest::collection::vec(slip(), 1..4)) {
        let text = slips.iter().fold(REFERENCE.to_owned(), |text, one| slipped(&text, one));
        assert_is_judged(&text);
    }

    #[test]
    fn no_text_makes_the_reader_panic(text in "\\PC{0,60}|[\\[\\]\\.=\"'#a-z0-9\n ]{0,80}") {
        assert_is_judged(&text);
    }
}

#[test]
fn a_text_nested_past_all_reason_is_refused() {
    for open in ["[", "{a=", "a."] {
        assert_is_judged(&format!("a = {}", open.repeat(5_000)));
        assert_is_judged(&format!("{}b = 1", open.repeat(5_000)));
    }
}
