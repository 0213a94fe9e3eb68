//! What is wrong with a file: every problem at once, each at its place in the text.
//!
//! Invariant: a problem points at the bytes it is about, and says what would be right.

use std::fmt;
use std::ops::Range;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

/// One thing wrong at one place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Bytes of the text it is about.
    pub span: Range<usize>,
    /// Full key, as `axis.x.limits.current-a`.
    pub key: String,
    /// What is wrong, with value, bound and unit.
    pub title: String,
    /// What would be right, at the place itself.
    pub label: String,
}

/// A file with problems.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileProblems {
    /// Name of the file, or of the embedded machine.
    pub file: String,
    /// Its text.
    pub text: String,
    /// In order of the text.
    pub problems: Vec<Problem>,
}

impl FileProblems {
    /// As a compiler would show it; with colours for a terminal.
    pub fn render(&self, with_colours: bool) -> String {
        let renderer = if with_colours { Renderer::styled() } else { Renderer::plain() };
        let reports: Vec<Group<'_>> = self
            .problems
            .iter()
            .map(|problem| {
                let place = AnnotationKind::Primary.span(problem.span.clone()).label(&problem.label);
                Level::ERROR
                    .primary_title(format!("{}: {}", problem.key, problem.title))
                    .element(Snippet::source(&self.text).path(&self.file).annotation(place))
            })
            .collect();
        reports
            .iter()
            .map(|report| renderer.render(std::slice::from_ref(report)) + "\n")
            .collect::<Vec<_>>()
            .join("\n")
    }

    /// All of them in one line, to be told as the cause of another problem.
    pub(super) fn in_one_line(&self) -> String {
        self.lines().collect::<Vec<_>>().join("; ")
    }

    fn lines(&self) -> impl Iterator<Item = String> {
        self.problems.iter().map(|problem| {
            let line = self.line(problem);
            format!("{}:{line}: {}: {} ({})", self.file, problem.key, problem.title, problem.label)
        })
    }

    /// Line of a problem, counted from 1.
    pub fn line(&self, problem: &Problem) -> usize {
        self.text.bytes().take(problem.span.start).filter(|&byte| byte == b'\n').count() + 1
    }
}

impl fmt::Display for FileProblems {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.problems.len();
        write!(out, "{} has {count} problem{}", self.file, if count == 1 { "" } else { "s" })?;
        self.lines().try_for_each(|line| write!(out, "\n{line}"))
    }
}

impl std::error::Error for FileProblems {}
