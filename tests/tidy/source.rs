//! Sources as the rules see them: text, code without comments and literals, tokens, imported modules.
//!
//! This is no parser of Rust, it knows just enough of it: comments, literals, braces and `use` trees.
//! Invariant: whatever is blanked or skipped, a line keeps its number.

use std::fs;
use std::path::{Path, PathBuf};

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A source file: its path from the root, its text, and its code without comments and literals.
pub(crate) struct Source {
    pub(crate) path: String,
    pub(crate) text: String,
    pub(crate) code: String,
}

impl Source {
    /// Path of the module below its crate: `rt/drive/mod.rs` and `rt/drive.rs` are both `[rt, drive]`.
    pub(crate) fn module(&self) -> Vec<String> {
        let below = self.path.split_once("src/").map_or(self.path.as_str(), |(_, below)| below);
        let mut names: Vec<String> = below.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
        if names.last().is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str())) {
            names.pop();
        }
        names
    }
    /// Whether the whole file is test code.
    pub(crate) fn is_test(&self) -> bool {
        self.path.starts_with("tests/") || self.path.contains("/tests/") || self.path.ends_with("/tests.rs")
    }
    /// Lines ahead of the test module at the end of the file.
    pub(crate) fn code_lines(&self) -> usize {
        let lines: Vec<&str> = self.text.lines().collect();
        let opens =
            |pair: &[&str]| pair[0] == "#[cfg(test)]" && pair[1].contains("mod ") && pair[1].ends_with('{');
        lines.windows(2).position(opens).unwrap_or(lines.len())
    }
}

/// Every file below `folder` whose name ends in one of `ends`, in order.
pub(crate) fn files(folder: &Path, ends: &[&str]) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let below = |path: PathBuf| if path.is_dir() { files(&path, ends) } else { vec![path] };
    let ends_right = |path: &PathBuf| ends.iter().any(|end| path.to_string_lossy().ends_with(end));
    paths.into_iter().filter(|path| !path.ends_with("target")).flat_map(below).filter(ends_right).collect()
}

pub(crate) fn relative(path: &Path) -> String {
    path.strip_prefix(root()).unwrap().to_string_lossy().into_owned()
}

pub(crate) fn sources() -> Vec<Source> {
    let found: Vec<Source> = ["src", "hil-sim", "tests"]
        .iter()
        .flat_map(|folder| files(&root().join(folder), &[".rs"]))
        .map(|path| {
            let text = fs::read_to_string(&path).unwrap();
            Source { path: relative(&path), code: code_of(&text), text }
        })
        .collect();
    assert!(found.len() > 50, "only {} source files were found", found.len());
    found
}

/// The text with comments, strings and characters blanked, line by line in place.
fn code_of(text: &str) -> String {
    let mut code = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = literal_length(rest).unwrap_or(0);
        if length == 0 {
            code.push(first);
            rest = &rest[first.len_utf8()..];
        } else {
            code.extend(rest[..length].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
            rest = &rest[length..];
        }
    }
    code
}

/// Length of the comment or literal that the text begins with.
fn literal_length(text: &str) -> Option<usize> {
    let through = |end: &str, from: usize| text.get(from..)?.find(end).map(|at| from + at + end.len());
    if text.starts_with("//") {
        Some(text.find('\n').unwrap_or(text.len()))
    } else if text.starts_with("/*") {
        through("*/", 2)
    } else if text.starts_with("r\"") {
        through("\"", 2)
    } else if text.starts_with("r#\"") {
        through("\"#", 3)
    } else if text.starts_with('"') {
        quoted_length(text, '"')
    } else if text.starts_with("'\\") {
        quoted_length(text, '\'')
    } else if text.starts_with('\'') {
        // A character, unless it is the tick of a lifetime.
        let (at, third) = text.char_indices().nth(2)?;
        (third == '\'').then_some(at + 1)
    } else {
        None
    }
}

/// Length of a literal between two marks; a mark behind a backslash ends nothing.
fn quoted_length(text: &str, mark: char) -> Option<usize> {
    let mut is_escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if c == mark && !is_escaped {
            return Some(at + 1);
        }
        is_escaped = c == '\\' && !is_escaped;
    }
    None
}

/// Names, `::` and single signs of a code, each with its line.
pub(crate) fn tokens(code: &str) -> Vec<(usize, String)> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut found: Vec<(usize, String)> = Vec::new();
    for (number, line) in code.lines().enumerate() {
        let mut rest = line;
        while let Some(first) = rest.chars().next() {
            let length = if is_name(first) {
                rest.find(|c| !is_name(c)).unwrap_or(rest.len())
            } else if rest.starts_with("::") {
                2
            } else {
                first.len_utf8()
            };
            if !first.is_whitespace() {
                found.push((number + 1, rest[..length].to_owned()));
            }
            rest = &rest[length..];
        }
    }
    found
}

/// Reads the paths of a `use` tree, or of an expression, from `at` on; returns where it ends.
fn read_tree(
    tokens: &[(usize, String)],
    mut at: usize,
    prefix: &[String],
    out: &mut Vec<(usize, Vec<String>)>,
) -> usize {
    let mut path = prefix.to_vec();
    while let Some((line, token)) = tokens.get(at) {
        match token.as_str() {
            "{" => {
                at += 1;
                while tokens.get(at).is_some_and(|(_, token)| token != "}") {
                    at = if tokens[at].1 == "," { at + 1 } else { read_tree(tokens, at, &path, out) };
                }
                return at + 1;
            }
            "self" if !path.is_empty() => {}
            _ => path.push(token.clone()),
        }
        at += 1;
        if tokens.get(at).is_none_or(|(_, token)| token != "::") {
            out.push((*line, path));
            // `as name` belongs to the tree, not to the next path.
            let is_renamed = tokens.get(at).is_some_and(|(_, token)| token == "as");
            return if is_renamed { at + 2 } else { at };
        }
        at += 1;
    }
    at
}

/// Modules of this project that a file names, with the line: `crate::`, `super::` and `quadrant::` paths.
pub(crate) fn imports(source: &Source) -> Vec<(usize, Vec<String>)> {
    let is_library = source.path.starts_with("src/") && !source.path.starts_with("src/bin/");
    let tokens = tokens(&source.code);
    let mut module = source.module();
    // Where modules written inside the file end: the depth of braces at which each was opened.
    let mut inner: Vec<usize> = Vec::new();
    let mut depth = 0;
    let mut found = Vec::new();
    for (at, (_, token)) in tokens.iter().enumerate() {
        let follows = |step: usize, what: &str| tokens.get(at + step).is_some_and(|(_, token)| token == what);
        match token.as_str() {
            "mod" if follows(2, "{") => {
                module.push(tokens[at + 1].1.clone());
                inner.push(depth);
            }
            "{" => depth += 1,
            "}" => {
                depth -= 1;
                if inner.last() == Some(&depth) {
                    inner.pop();
                    module.pop();
                }
            }
            "crate" | "super" | "quadrant" if follows(1, "::") && (at == 0 || tokens[at - 1].1 != "::") => {
                let mut paths = Vec::new();
                read_tree(&tokens, at, &[], &mut paths);
                let own = |path: Vec<String>| absolute(&module, path, is_library);
                found.extend(paths.into_iter().filter_map(|(line, path)| Some((line, own(path)?))));
            }
            _ => {}
        }
    }
    found
}

/// The path from the root of the library; `None` for a path inside another crate.
fn absolute(module: &[String], path: Vec<String>, is_library: bool) -> Option<Vec<String>> {
    let ups = path.iter().take_while(|name| *name == "super").count();
    match path[0].as_str() {
        "quadrant" if !is_library => Some(path[1..].to_vec()),
        "crate" if is_library => Some(path[1..].to_vec()),
        "super" if is_library => {
            Some(module[..module.len().saturating_sub(ups)].iter().chain(&path[ups..]).cloned().collect())
        }
        _ => None,
    }
}
