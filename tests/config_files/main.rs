//! Promise: every shipped machine file is sound, and a file that is not is told so in full: each problem
//! with file, line, key, value, allowed range and unit, in order of the text, and none that is only the
//! consequence of another. No text makes the reader panic, and a machine that it lets pass can be built.
//! `bad_machines.txt` is the table of what is said.

mod sheets;
mod slips;

use std::path::Path;

use quadrant::config::edit::MachineFile;
use quadrant::config::problem::FileProblems;
use quadrant::config::{self, LoadError, Purpose};
use quadrant::rt::thread;

const REFERENCE: &str = include_str!("../../firmware-config/machines/reference.toml");
const BAD_MACHINES: &str = include_str!("bad_machines.txt");

#[test]
fn every_shipped_machine_file_is_sound() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware-config/machines");
    let mut names = Vec::new();
    for entry in folder.read_dir().expect("the folder is part of the project") {
        let path = entry.expect("the folder can be read").path();
        let machine = config::load(&path.to_string_lossy())
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert_eq!(Some(machine.name.as_str()), path.file_stem().and_then(|stem| stem.to_str()));
        names.push(machine.name);
    }
    for (name, _) in config::EMBEDDED {
        assert!(names.iter().any(|known| known == name), "no file for the embedded machine {name}");
    }
}

fn problems(file: &str, text: &str) -> FileProblems {
    match config::from_texts(file, text, &Default::default()) {
        Err(problems) => *problems,
        Ok(_) => panic!("{file} is taken for sound"),
    }
}

/// The reference file with the first occurrence of a text replaced.
fn changed(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the reference file has no {from:?}");
    text.replacen(from, to, 1)
}

/// A case of the table: the changed file, and what should be said of it.
fn case(paragraph: &str) -> (String, String) {
    let mut changes: Vec<(Vec<&str>, Vec<&str>)> = Vec::new();
    let mut places = Vec::new();
    for line in paragraph.lines() {
        let (kind, text) = line.split_at(1);
        let text = text.strip_prefix(' ').unwrap_or(text);
        match (kind, changes.last_mut()) {
            ("-", Some((from, to))) if to.is_empty() => from.push(text),
            ("-", _) => changes.push((vec![text], Vec::new())),
            ("+", Some((_, to))) => to.push(text),
            ("@", _) => places.push(text.split_once(" | ").expect("a place and what is said")),
            _ => panic!("not a line of the table: {line:?}"),
        }
    }
    let text = changes
        .iter()
        .fold(REFERENCE.to_owned(), |text, (from, to)| changed(&text, &from.join("\n"), &to.join("\n")));
    let line = |at: &str| 1 + text.lines().position(|line| line.contains(at)).expect("the place is there");
    let count = places.len();
    let mut said = format!("bad.toml has {count} problem{}", if count == 1 { "" } else { "s" });
    for (at, says) in places {
        said += &format!("\nbad.toml:{}: {says}", line(at));
    }
    (text, said)
}

#[test]
fn each_bad_machine_file_is_told_what_is_wrong_where() {
    let is_case = |paragraph: &&str| paragraph.starts_with('-');
    let paragraphs: Vec<&str> = BAD_MACHINES.split("\n\n").filter(is_case).collect();
    assert!(paragraphs.len() >= 40, "{} cases", paragraphs.len());
    for paragraph in paragraphs {
        let (text, said) = case(paragraph.trim_end());
        assert_eq!(problems("bad.toml", &text).to_string(), said, "after\n{paragraph}");
    }
}

#[test]
fn a_fast_axis_is_fine_as_long_as_its_encoder_cannot_wrap_unseen() {
    // 2^28 counts/mm and nine periods of 0.5 ms: five times 355.56 mm/s pass half of 2^32 counts.
    let text = changed(REFERENCE, "counts-per-mm = 100000", "counts-per-mm = 268_435_456");
    let text = changed(&text, "velocity-mm-per-s = 250.0", "velocity-mm-per-s = 355.5");
    assert!(config::from_texts("fine.toml", &text, &Default::default()).is_ok(), "355.5 mm/s are told apart");
}

#[test]
fn a_cycle_too_short_for_its_bus_runs_no_machine_and_tells_what_files_hold() {
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join("fast.toml");
    let text = changed(REFERENCE, "period-us = 500", "period-us = 250");
    let text = changed(&text, "reply-window-us = 300", "reply-window-us = 150");
    std::fs::write(&path, changed(&text, "position-loop-every-cycles = 4", "position-loop-every-cycles = 8"))
        .expect("the file can be written");
    let name = path.to_string_lossy();
    let error = config::load(&name).expect_err("no bus carries as much").to_string();
    assert!(error.contains("% of the bus"), "{error}");
    let machine = config::load_for(Purpose::Files, &name).expect("runs were recorded");
    assert_eq!(machine.cycle.period.as_us(), 250.0);
    let mut file = MachineFile::open(&path).expect("what files tell can be written down");
    file.set("axis.x.mechanics.mass-kg", 300.0).expect("a number");
    file.replace().expect("a sound machine");
}

#[test]
fn the_processor_of_the_cycle_may_be_named() {
    let read = |text: &str| config::from_texts("fine.toml", text, &Default::default()).expect("a sound file");
    assert_eq!(read(REFERENCE).real_time, thread::Settings { priority: 80, cpu: None });
    let text = changed(REFERENCE, "# cpu = 3", "cpu = 3");
    assert_eq!(read(&text).real_time, thread::Settings { priority: 80, cpu: Some(3) });
}

#[test]
fn gain_sets_are_one_to_eight() {
    let (before, rest) = REFERENCE.split_once("[axis.x.gains.standard]").expect("the file has gains");
    let (_, after) = rest.split_once("[axis.x.limits]").expect("the file has limits");
    let none = format!("{before}[axis.x.gains]\n[axis.x.limits]{after}");
    let said = problems("none.toml", &none).to_string();
    assert!(said.contains("axis.x.gains.standard: missing, wanted is a section"), "{said}");

    let mut many = REFERENCE.to_owned();
    for axis in ["x", "y"] {
        let sets = many.split_once(&format!("[axis.{axis}.gains.optimal]")).expect("the file has gains").1;
        let set = sets.split_once("\n\n").expect("a section ends with an empty line").0.to_owned();
        for number in 3..=9 {
            many += &format!("\n[axis.{axis}.gains.number-{number}]{set}\n");
        }
    }
    let said = problems("many.toml", &many);
    let titles: Vec<_> =
        said.problems.iter().map(|problem| (problem.key.as_str(), problem.title.as_str())).collect();
    assert_eq!(titles, [("axis.x.gains", "9 gain sets"), ("axis.y.gains", "9 gain sets")]);
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let error = config::load("no/such/file.toml").expect_err("there is no such file");
    assert!(matches!(&error, LoadError::Unreadable { .. }), "{error}");
    assert!(error.to_string().starts_with("machine file no/such/file.toml: "), "{error}");
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join("latin.toml");
    std::fs::write(&path, b"name = \"Fr\xe4se\"\n").expect("the file can be written");
    let error = config::load(&path.to_string_lossy()).expect_err("this is not UTF-8");
    assert!(error.to_string().contains("UTF-8"), "{error}");
}

#[test]
fn several_problems_are_told_at_once_in_order_of_the_text() {
    let text = [
        ("period-us = 500 ", "period-us = 5 "),
        ("data-bit-rate-kbit-per-s = 5000", "data-bit-rate-kbit-per-s = 900"),
        ("lead-mm = 10.0", "lead-mm = 0.0"),
        ("sliding-n = 951.3", "sliding-n = 2000.0"),
        ("[axis.y.drive]", "[axis.y.driver]"),
    ]
    .iter()
    .fold(REFERENCE.to_owned(), |text, (from, to)| changed(&text, from, to));
    let said = problems("bad.toml", &text);
    let keys: Vec<&str> = said.problems.iter().map(|problem| problem.key.as_str()).collect();
    assert_eq!(
        keys,
        [
            "cycle.period-us",
            "bus.data-bit-rate-kbit-per-s",
            "axis.x.mechanics.lead-mm",
            "axis.x.friction.sliding-n",
            "axis.y.drive",
            "axis.y.driver"
        ]
    );
    let lines: Vec<usize> = said.problems.iter().map(|problem| said.line(problem)).collect();
    assert!(lines.is_sorted(), "{lines:?}");
}

#[test]
fn a_problem_is_shown_at_its_place() {
    let shown = |from: &str, to: &str| problems("mill.toml", &changed(REFERENCE, from, to)).render(false);
    insta::assert_snapshot!(shown("reply-window-us = 300", "reply-window-us = 400"), @r"
    error: cycle.reply-window-us: 400 us and 130 us of commands pass the period
      --> mill.toml:15:19
       |
    15 | reply-window-us = 400             # feedback that comes later is stale
       |                   ^^^ allowed is up to 370 us
    ");
    insta::assert_snapshot!(shown("lead-mm = 10.0", "lead-m = 0.01"), @r"
    error: axis.x.mechanics.lead-mm: missing, wanted is a number from 0.1 to 200 mm
      --> mill.toml:65:9
       |
    65 | [axis.x.mechanics]
       |         ^^^^^^^^^ `lead-mm` belongs in here

    error: axis.x.mechanics.lead-m: unknown key
      --> mill.toml:70:1
       |
    70 | lead-m = 0.01
       | ^^^^^^ is `lead-mm` meant?
    ");
    insta::assert_snapshot!(shown("current-a = 20.0", "current-a = 25.1"), @r"
    error: axis.x.limits.current-a: 25.1 A is above the drive's peak current
       --> mill.toml:110:13
        |
    110 | current-a = 25.1
        |             ^^^^ allowed is 0.01 to 25 A
    ");
    insta::assert_snapshot!(shown("[bus]", "[bus"), @r"
    error: TOML: unclosed table, expected `]`
      --> mill.toml:21:5
       |
    21 | [bus
       |     ^ not understood here
    ");
}
