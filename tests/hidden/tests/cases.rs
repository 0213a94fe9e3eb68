//! A case as it is made: its severity, its files, and the same again from the same seed.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use hidden::case::Bench;
use hidden::effect::{Effect, Kind, Shape, What, features_of};
use hidden::machine::Machine;
use hidden::path::{Motion, Run};
use hidden::plan::{Choice, Form, Plan, Role, Severity, list};
use hidden::session::Session;
use hidden::severity::{STEPS, Visible, Yardstick};

/// A machine of the known answers behind real sensors, with two short circles: one to fit and one to judge by.
fn machine() -> Machine {
    let mut machine = Machine::drawn(6);
    machine.runs.retain(|run| run.name.starts_with("circle-r20") || run.name.starts_with("heldout-r8"));
    machine.runs.remove(0);
    assert_eq!(machine.runs.len(), 2);
    for run in &mut machine.runs {
        if let Motion::Circle { laps, .. } = &mut run.motion {
            *laps = 1;
        }
    }
    machine
}

#[test]
fn severity_is_what_base_parameters_cannot_explain() {
    let machine = machine();
    let stick = Yardstick::new(&machine);
    let visible = Visible { has_table: true, runs: vec![true; 2] };
    let base = Session::quiet(&machine, Default::default(), STEPS);
    assert_eq!(stick.severity(&base.run(), &visible), 0.0, "nothing is missing");

    let shape = Shape { choices: [0.1; 4], phase: 0.7, sign: 1.0 };
    let severity = |kind: Kind, amplitude: f64, visible: &Visible| {
        let effect = Effect { what: What::Named(kind), axis: 0, shape, amplitude };
        stick.severity(&Session { features: features_of(&[effect], &machine), ..base.clone() }.run(), visible)
    };
    let (one, two) = (severity(Kind::Backlash, 0.1, &visible), severity(Kind::Backlash, 0.2, &visible));
    assert!((1.8..2.2).contains(&(two / one)), "1 um has {one}, 2 um have {two}");
    let blind = Visible { has_table: false, ..visible.clone() };
    let [seen, unseen] = [&visible, &blind].map(|visible| severity(Kind::Squareness, 1.0, visible));
    assert!(seen > 1.0 && unseen == 0.0, "squareness has {seen} with a scale, {unseen} without");

    // A parameter that the oracle may fit: two per cent of the friction are next to nothing, without it they are not.
    let mut changed = machine.clone();
    for axis in &mut changed.axes {
        axis.plant.sliding *= 1.02;
        axis.plant.breakaway *= 1.02;
    }
    let left = stick.severity(&Session { machine: &changed, ..base.clone() }.run(), &visible);
    let unfitted = Visible { runs: vec![false, true], ..visible };
    let whole = stick.severity(&Session { machine: &changed, ..base.clone() }.run(), &unfitted);
    assert!(left < 0.3 * whole, "{left} with the run to fit, {whole} without it");
}

fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = fs::read_dir(folder).expect("a folder");
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files
        .into_iter()
        .map(|path| (path.file_name().expect("a name").into(), fs::read(&path).expect("a file")))
        .collect()
}

fn plan(role: Role, what: Vec<What>, form: Form) -> Plan {
    let severity = (role == Role::Single).then_some(Severity::Medium);
    Plan { id: "made".to_owned(), seed: 7, machine: 6, role, what, severity, form }
}

#[test]
fn a_case_meets_its_severity_and_is_the_same_again() {
    let bench = Bench::of(machine());
    let plan = plan(Role::Single, vec![What::Named(Kind::Backlash)], Form::Apart);
    let folder = std::env::temp_dir().join(format!("hidden-cases-{}", std::process::id()));
    let [first, second] = ["first", "second"].map(|name| {
        let folder = folder.join(name);
        let truth = bench.make(&plan, &folder).expect("files are written").expect("backlash is to be seen");
        assert!((30.0..=60.0).contains(&truth.d_prime), "d' {} is not medium", truth.d_prime);
        files(&folder.join("made"))
    });
    fs::remove_dir_all(&folder).expect("the folder goes away");
    assert!(first == second, "the same plan gives other bytes");
    let text = |name: &str| {
        let file = first.iter().find(|(path, _)| path.to_string_lossy().starts_with(name));
        String::from_utf8_lossy(&file.unwrap_or_else(|| panic!("no {name}")).1).into_owned()
    };
    assert!(text("machine.toml").contains("\nbacklash-um = 0.0\n"), "the machine file knows of no backlash");
    let rows = text("heldout");
    let (head, first_row) = (rows.lines().next().unwrap_or(""), rows.lines().nth(1).unwrap_or(""));
    assert!(head.starts_with("t_s,x.setpoint_mm,x.position_mm,x."), "{head}");
    assert!(
        head.ends_with("current_a,y.setpoint_mm,y.position_mm,y.current_a") || head.contains("y.table_mm")
    );
    assert_eq!(head.split(',').count(), first_row.split(',').count());
}

/// Files of a case without an effect, by name: their numbers, row by row.
fn delivered(form: Form) -> Vec<(String, Vec<Vec<f64>>)> {
    let folder = std::env::temp_dir().join(format!("hidden-forms-{form:?}-{}", std::process::id()));
    let made = Bench::of(machine()).make(&plan(Role::Null, Vec::new(), form), &folder);
    made.expect("files are written").expect("there is nothing to be seen");
    let numbers = |bytes: Vec<u8>| -> Vec<Vec<f64>> {
        let text = String::from_utf8(bytes).expect("text");
        text.lines()
            .skip(1)
            .map(|line| line.split(',').map(|value| value.parse().expect("a number")).collect())
            .collect()
    };
    let runs = files(&folder.join("made"))
        .into_iter()
        .filter(|(path, _)| path.extension().is_some_and(|end| end == "csv"));
    let runs = runs.map(|(path, bytes)| (path.display().to_string(), numbers(bytes))).collect();
    fs::remove_dir_all(&folder).expect("the folder goes away");
    runs
}

#[test]
fn forms_are_the_same_motions_with_other_starts_ends_and_clocks() {
    const STILL: usize = 800;
    let setpoints = |rows: &[Vec<f64>]| -> Vec<f64> { rows.iter().map(|row| row[1]).collect() };
    let [apart, rests, at_zero, one_file] =
        [Form::Apart, Form::Rests, Form::AtZero, Form::OneFile].map(delivered);
    assert_eq!(one_file.len(), 1);
    let session = &one_file[0].1;
    for (n, (name, rows)) in apart.iter().enumerate() {
        let motion = setpoints(rows);
        for form in [&rests, &at_zero] {
            assert_eq!(form[n].0, *name);
            let whole = setpoints(&form[n].1);
            let within = &whole[STILL..whole.len() - STILL];
            assert!(within == motion, "{name} is another motion");
            assert!(whole[..STILL].iter().all(|at| *at == motion[0]), "{name} does not begin at rest");
        }
        assert!(at_zero[n].1[0][0].abs() < 1e-4, "{name} begins at {} s", at_zero[n].1[0][0]);
        let begin = rests[n].1[0][0];
        let in_session = (begin / 5e-4).round() as usize;
        let rows_of = |rows: &[Vec<f64>]| rows.iter().map(|row| row[1..].to_vec()).collect::<Vec<_>>();
        assert!(
            rows_of(&session[in_session..in_session + rests[n].1.len()]) == rows_of(&rests[n].1),
            "{name} is not in the session at {begin} s"
        );
    }
    // Just switched on it leans on nothing; in one go friction holds it where the last way ended. In the middle of some rows, for loops answer to
    // a count of its encoder in one of them.
    let current = |form: &[(String, Vec<Vec<f64>>)]| {
        let rows = &form[1].1;
        let at = rows[0].len() - 1;
        let mut first: Vec<f64> = rows[..9].iter().map(|row| row[at]).collect();
        first.sort_by(f64::total_cmp);
        first[4].abs()
    };
    assert!(current(&rests) > 10.0 * current(&apart), "{} A of {} A", current(&rests), current(&apart));
}

#[test]
fn brief_runs_are_of_every_kind_and_take_less_than_half_as_long() {
    for seed in [0, 8] {
        let [long, brief] = [Machine::drawn(seed), Machine::drawn(seed).brief()];
        let rows = |machine: &Machine| machine.runs.iter().map(|run| run.setpoints().len()).sum::<usize>();
        assert!(2 * rows(&brief) < rows(&long), "{} rows of {}", rows(&brief), rows(&long));
        let kinds = |machine: &Machine| {
            machine
                .runs
                .iter()
                .map(|run| (std::mem::discriminant(&run.motion), run.is_held_out))
                .collect::<HashSet<_>>()
        };
        assert_eq!(kinds(&brief), kinds(&long));
        let circles = |is_held_out: bool| -> Vec<(bool, bool)> {
            let of = |run: &Run| match run.motion {
                Motion::Circle { feed, is_ccw, .. } => Some((feed > 0.04, is_ccw)),
                _ => None,
            };
            brief.runs.iter().filter(|run| run.is_held_out == is_held_out).filter_map(of).collect()
        };
        assert_eq!(circles(false), [(false, true), (true, false)], "slow one way, fast the other");
        assert_eq!(circles(true).len(), 2);
    }
}

#[test]
fn a_share_has_every_name_and_every_severity_in_it() {
    let choice = |share| Choice {
        role: None,
        seed: 1,
        machines: 6,
        only: None,
        severity: None,
        nulls: 300,
        pairs: 60,
        unknown: 48,
        decoys: 30,
        form: Vec::new(),
        brief: false,
        share,
    };
    let (all, fifth) = (list(&choice(1)), list(&choice(5)));
    assert!(fifth.iter().all(|plan| all.contains(plan)), "a share has cases of its own");
    assert!(all.len().abs_diff(5 * fifth.len()) <= 50, "{} of {} is no fifth", fifth.len(), all.len());
    let is_of = |plan: &&Plan, kind: Kind| plan.role == Role::Single && plan.what == [What::Named(kind)];
    for (kind, name) in hidden::effect::NAMES {
        let of_kind = fifth.iter().filter(|plan| is_of(plan, *kind));
        let severities: Vec<Severity> = of_kind.filter_map(|plan| plan.severity).collect();
        assert!(severities.len() >= 3, "{name} is {} times in a fifth", severities.len());
    }
    // A name has eighteen cases: so few are drawn of them that it is just not left out.
    let seventeenth = list(&choice(17));
    assert!(hidden::effect::NAMES.iter().all(|(kind, _)| seventeenth.iter().any(|plan| is_of(&plan, *kind))));
}
