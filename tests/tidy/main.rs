//! The style of the house as a test: who may import whom, and what no file may contain.
//!
//! Every rule reads the sources as text, so it also holds in builds that leave a floor out. A breach is
//! reported as `file:line: rule`, all of them at once.
//! Invariant: [`ROOMS`] is the import table; the one in `ARCHITECTURE.md` equals it.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

mod source;

use source::{Source, files, imports, relative, root, sources, tokens};

/// A part of the tree, and what its files may import beside the part itself.
struct Room {
    /// Path below `src/`, or the name of a workspace member.
    name: &'static str,
    /// Paths it may import; a floor includes its rooms.
    may: &'static [&'static str],
}

impl Room {
    /// What it may import, as the table says it.
    fn may_in_words(&self) -> String {
        if self.may.is_empty() { "nothing of ours".to_owned() } else { self.may.join(", ") }
    }
}

/// The import table, floor by floor from the ground; a file belongs to its longest match.
const ROOMS: &[Room] = &[
    Room { name: "base", may: &[] },
    Room { name: "plant", may: &["base"] },
    Room { name: "rt", may: &["base"] },
    Room { name: "rt/clock", may: &["base"] },
    Room { name: "rt/bus", may: &["base", "rt/clock"] },
    Room { name: "rt/wire", may: &["base", "rt/bus"] },
    Room { name: "rt/drive", may: &["base", "rt/bus", "rt/wire"] },
    Room { name: "rt/control", may: &["base", "plant"] },
    Room { name: "rt/door", may: &["base", "rt/control"] },
    Room { name: "rt/cycle", may: &["base", "rt"] },
    Room { name: "rt/thread", may: &["base", "rt/cycle"] },
    Room { name: "sim", may: &["base", "plant", "rt"] },
    Room { name: "config", may: &["base", "plant", "rt", "sim"] },
    Room { name: "candump", may: &["base"] },
    Room { name: "log", may: &["base"] },
    Room { name: "run", may: &["base", "plant", "rt", "config", "log"] },
    Room { name: "service", may: &["base", "plant", "rt", "sim", "config", "log", "run"] },
    Room { name: "offline", may: &["base", "plant", "rt", "sim", "config", "candump", "log"] },
    Room { name: "cli", may: &["base", "plant", "rt", "sim", "config", "candump", "log", "run", "offline"] },
    Room { name: "bin", may: &["cli", "service"] },
    Room { name: "hil-sim", may: &["base", "plant", "rt", "sim", "config", "candump"] },
];

/// Folders of `src/offline/gap`, each of which imports from those before it alone.
const STEPS_OF_GAP: [&str; 9] =
    ["runs", "measure", "model", "fit", "locate", "shortlist", "gates", "name", "show"];

/// Most lines of a file that are not tests.
const LINES_MAX: usize = 400;
/// Words that name nothing, as a part of any name.
const EMPTY_WORDS: [&str; 6] = ["manager", "helper", "helpers", "util", "utils", "misc"];
/// Macros that leave work undone.
const UNDONE: [&str; 3] = ["todo", "unimplemented", "dbg"];
/// Files that may say `unsafe`, each block with its reason.
const UNSAFE_FILES: [&str; 3] =
    ["src/rt/bus/socketcan/batch.rs", "src/rt/thread/raw.rs", "tests/common/heap.rs"];
/// Starts of paths that only exist on one machine; split, so that this file may say them.
const MACHINE_PATHS: [&str; 5] = [
    concat!("/wo", "rk/"),
    concat!("/tm", "p/"),
    concat!("/ro", "ot/"),
    concat!("/ho", "me/"),
    concat!("/Us", "ers/"),
];
/// Where the project's own text is.
const TEXT: [&str; 8] = ["src", "tests", "hil-sim", "docs", "firmware-config", "systemd", ".ci", ".github"];

/// Whether a module path lies in a room or floor.
fn lies_in(path: &[String], room: &str) -> bool {
    let mut names = path.iter();
    room.split('/').all(|name| names.next().is_some_and(|own| own == name))
}

/// The room that a file belongs to; `None` for the root of the library and for tests.
fn room_of(source: &Source) -> Option<&'static Room> {
    let mut module = source.module();
    if source.path.starts_with("hil-sim/") {
        module.insert(0, "hil-sim".to_owned());
    }
    ROOMS.iter().filter(|room| lies_in(&module, room.name)).max_by_key(|room| room.name.len())
}

#[track_caller]
fn nothing_in(breaches: &[String]) {
    assert!(breaches.is_empty(), "{} breach(es):\n{}", breaches.len(), breaches.join("\n"));
}

/// A breach for each line of code, named and numbered, in which `rule` finds one.
fn by_token(source: &Source, rule: impl Fn(&[(usize, String)]) -> Option<String>) -> Vec<String> {
    let tokens = tokens(&source.code);
    let breach = |at: usize| Some(format!("{}:{}: {}", source.path, tokens[at].0, rule(&tokens[at..])?));
    (0..tokens.len()).filter_map(breach).collect()
}

#[test]
fn imports_point_down() {
    let mut breaches = Vec::new();
    for source in sources().iter().filter(|source| !source.path.starts_with("tests/")) {
        let Some(room) = room_of(source) else {
            let has_none = imports(source).is_empty();
            assert!(
                source.path == "src/lib.rs" && has_none,
                "{} is in no room of the import table",
                source.path
            );
            continue;
        };
        for (line, path) in imports(source) {
            let may = |other: &str| lies_in(&path, other);
            if !may(room.name) && !room.may.iter().any(|other| may(other)) {
                let (path, may) = (path.join("::"), room.may_in_words());
                let rule = format!("`{}` must not import `{path}`, only: {may}", room.name);
                breaches.push(format!("{}:{line}: {rule}", source.path));
            }
        }
    }
    nothing_in(&breaches);
}

#[test]
fn steps_of_the_gap_import_from_those_before_them_alone() {
    let place = |module: &[String]| {
        let step = module.strip_prefix(["offline".to_owned(), "gap".to_owned()].as_slice())?.first()?;
        Some(STEPS_OF_GAP.iter().position(|known| known == step).unwrap_or(STEPS_OF_GAP.len()))
    };
    let mut breaches = Vec::new();
    let mut steps_seen = [false; STEPS_OF_GAP.len()];
    for source in sources().iter().filter(|source| source.path.starts_with("src/")) {
        let Some(step) = place(&source.module()).filter(|step| *step < STEPS_OF_GAP.len()) else { continue };
        steps_seen[step] = true;
        for (line, path) in imports(source) {
            if place(&path).is_some_and(|other| other > step) {
                let (name, path) = (STEPS_OF_GAP[step], path.join("::"));
                breaches.push(format!("{}:{line}: step `{name}` must not import `{path}`", source.path));
            }
        }
    }
    assert_eq!(steps_seen, [true; STEPS_OF_GAP.len()], "a folder of the gap is not there");
    nothing_in(&breaches);
}

#[test]
fn the_import_table_stands_in_the_architecture() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let (_, table) = text.split_once("<!-- imports -->").unwrap();
    let (table, _) = table.split_once("<!-- /imports -->").unwrap();
    let rows = table.lines().filter(|line| line.starts_with("| `")).map(|line| {
        let cells: Vec<&str> = line.split('|').map(|cell| cell.trim()).collect();
        (cells[1].replace('`', ""), cells[2].replace('`', ""))
    });
    let written: BTreeMap<String, String> = rows.collect();
    let held: BTreeMap<String, String> =
        ROOMS.iter().map(|room| (room.name.to_owned(), room.may_in_words())).collect();
    assert_eq!(written, held, "left: ARCHITECTURE.md, right: tests/tidy.rs");
}

#[test]
fn every_module_says_what_it_is_for() {
    // The map, the entry points and the verbs have a purpose, but nothing below them to keep a promise to.
    let is_leaf = |source: &Source| {
        source.path == "src/lib.rs" || ["src/bin/", "src/cli/"].iter().any(|end| source.path.starts_with(end))
    };
    let breach = |source: &Source| {
        let header: Vec<&str> = source.text.lines().take_while(|line| line.starts_with("//!")).collect();
        let is_kept = header.iter().any(|line| line.contains("Invariant:"));
        let needs_invariant = source.path.starts_with("src/") && !is_leaf(source) && !source.is_test();
        if header.is_empty() {
            Some(format!("{}:1: a module opens with `//!` and its purpose", source.path))
        } else if needs_invariant && !is_kept {
            Some(format!("{}:{}: the header has a line `Invariant: ...`", source.path, header.len()))
        } else {
            None
        }
    };
    nothing_in(&sources().iter().filter_map(breach).collect::<Vec<_>>());
}

#[test]
fn no_file_outgrows_its_subject() {
    let breach = |source: &Source| {
        let lines = source.code_lines();
        (lines > LINES_MAX)
            .then(|| format!("{}:{lines}: more than {LINES_MAX} lines that are not tests", source.path))
    };
    nothing_in(&sources().iter().filter_map(breach).collect::<Vec<_>>());
}

#[test]
fn names_say_something() {
    let breach = |source: &Source| {
        by_token(source, |tokens| {
            let name = &tokens[0].1;
            let split =
                |c: char| if c.is_uppercase() { format!("_{}", c.to_lowercase()) } else { c.to_string() };
            let words: String = name.chars().map(split).collect();
            let empty = words.split('_').find(|word| EMPTY_WORDS.contains(word))?;
            Some(format!("`{name}`: \"{empty}\" names nothing"))
        })
    };
    nothing_in(&sources().iter().flat_map(breach).collect::<Vec<_>>());
}

#[test]
fn nothing_is_left_undone_or_unwrapped() {
    let breach = |source: &Source| {
        let tests_from = if source.is_test() { 0 } else { source.code_lines() };
        by_token(source, |tokens| {
            let follows = |step: usize, what: &str| tokens.get(step).is_some_and(|(_, token)| token == what);
            let (line, token) = &tokens[0];
            if UNDONE.contains(&token.as_str()) && follows(1, "!") {
                Some(format!("`{token}!` is no code"))
            } else if token == "." && follows(1, "unwrap") && follows(2, "(") && *line <= tests_from {
                Some("no `unwrap` outside tests; `expect` says why it cannot fail".to_owned())
            } else {
                None
            }
        })
    };
    nothing_in(&sources().iter().flat_map(breach).collect::<Vec<_>>());
}

#[test]
fn unsafe_stays_where_it_is_expected() {
    let breach = |source: &Source| {
        by_token(source, |tokens| {
            let is_breach = tokens[0].1 == "unsafe" && !UNSAFE_FILES.contains(&source.path.as_str());
            is_breach.then(|| format!("`unsafe` is for these files only: {}", UNSAFE_FILES.join(", ")))
        })
    };
    nothing_in(&sources().iter().flat_map(breach).collect::<Vec<_>>());
}

/// Every text of the project: its files at the top, and its folders.
fn texts() -> Vec<(String, String)> {
    let top = fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
    let below = TEXT.iter().flat_map(|folder| files(&root().join(folder), &[""]));
    // What is no text (a picture, a log) has no lines to hold to a rule. `.git` is a file in a work tree.
    let read = |path: PathBuf| Some((relative(&path), fs::read_to_string(&path).ok()?));
    top.chain(below).filter(|path| !path.ends_with(".git")).filter_map(read).collect()
}

#[test]
fn no_text_knows_the_machine_it_was_written_on() {
    let mut breaches = Vec::new();
    for (path, text) in texts() {
        for (number, line) in text.lines().enumerate() {
            let named = MACHINE_PATHS.iter().find(|start| line.contains(*start));
            breaches.extend(
                named.map(|start| format!("{path}:{}: `{start}` is a path of one machine", number + 1)),
            );
        }
    }
    nothing_in(&breaches);
}

#[test]
fn links_between_pages_lead_somewhere() {
    let mut breaches = Vec::new();
    for (path, text) in texts().into_iter().filter(|(path, _)| path.ends_with(".md")) {
        let folder = root().join(&path).parent().unwrap().to_owned();
        for (number, line) in text.lines().enumerate() {
            let targets = line.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
            for target in targets.filter(|target| !target.is_empty() && !target.contains("://")) {
                if !folder.join(target).exists() {
                    breaches.push(format!("{path}:{}: nothing is at `{target}`", number + 1));
                }
            }
        }
    }
    nothing_in(&breaches);
}
