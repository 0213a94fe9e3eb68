//! Reads a TOML text section by section, noting every problem instead of stopping at the first.
//!
//! A [`Section`] hands out values by key with unit and range, remembers which keys were asked for, and
//! names the rest as unknown when it is closed. After a problem a harmless value stands in, so that
//! reading goes on; nothing read from a text with problems leaves `config`.
//! Invariant: a key that is not asked for is a problem; there are no silent defaults.

use std::cell::RefCell;
use std::ops::{Range, RangeInclusive};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::problem::{FileProblems, Problem};

/// Collects problems while a text is read.
#[derive(Debug, Default)]
pub(super) struct Notes {
    problems: RefCell<Vec<Problem>>,
}

impl Notes {
    /// Note a problem.
    pub(super) fn add(
        &self,
        span: Range<usize>,
        key: &str,
        title: impl Into<String>,
        label: impl Into<String>,
    ) {
        let problem = Problem { span, key: key.to_owned(), title: title.into(), label: label.into() };
        self.problems.borrow_mut().push(problem);
    }

    /// All of them against the text, or `value` where there are none.
    pub(super) fn into_result<T>(self, file: &str, text: &str, value: T) -> Result<T, FileProblems> {
        let mut problems = self.problems.into_inner();
        if problems.is_empty() {
            return Ok(value);
        }
        problems.sort_by_key(|problem| problem.span.start);
        Err(FileProblems { file: file.to_owned(), text: text.to_owned(), problems })
    }
}

/// Parse a text; grammar errors are noted, what could be read is returned.
pub(super) fn parse<'t>(text: &'t str, notes: &Notes) -> Spanned<DeTable<'t>> {
    let (table, errors) = DeTable::parse_recoverable(text);
    for error in errors {
        let span = error.span().unwrap_or(0..0);
        notes.add(span, "TOML", error.message(), "not understood here");
    }
    table
}

/// One table of the text, while it is read.
pub(super) struct Section<'t> {
    notes: &'t Notes,
    table: Option<&'t DeTable<'t>>,
    span: Range<usize>,
    path: String,
    asked: RefCell<Vec<String>>,
}

impl<'t> Section<'t> {
    /// The whole text.
    pub(super) fn root(table: &'t Spanned<DeTable<'t>>, notes: &'t Notes) -> Self {
        Self {
            notes,
            table: Some(table.get_ref()),
            span: 0..0,
            path: String::new(),
            asked: RefCell::default(),
        }
    }

    /// The full name of a key in here.
    pub(super) fn key(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Where a key's value stands, or the section where it is missing.
    pub(super) fn span_of(&self, key: &str) -> Range<usize> {
        self.value(key).map_or_else(|| self.span.clone(), |value| value.span())
    }

    /// Note that a value does not fit with others.
    pub(super) fn object(&self, key: &str, title: impl Into<String>, label: impl Into<String>) {
        self.notes.add(self.span_of(key), &self.key(key), title, label);
    }

    /// Names of the keys in here, in order of the text.
    pub(super) fn keys(&self) -> Vec<String> {
        let mut keys: Vec<_> = self.table.into_iter().flat_map(|table| table.keys()).collect();
        keys.sort_by_key(|key| key.span().start);
        keys.into_iter().map(|key| key.get_ref().to_string()).collect()
    }

    fn value(&self, key: &str) -> Option<&'t Spanned<DeValue<'t>>> {
        self.table.and_then(|table| table.get(key))
    }

    fn ask(&self, key: &str) -> Option<&'t Spanned<DeValue<'t>>> {
        self.asked.borrow_mut().push(key.to_owned());
        self.value(key)
    }

    fn require(&self, key: &str, wanted: &str) -> Option<&'t Spanned<DeValue<'t>>> {
        let value = self.ask(key);
        // A missing section was noted once; its keys are not noted again.
        if value.is_none() && self.table.is_some() {
            let title = format!("missing, wanted is {wanted}");
            self.notes.add(self.span.clone(), &self.key(key), title, format!("`{key}` belongs in here"));
        }
        value
    }

    fn wrong_type(&self, key: &str, value: &Spanned<DeValue<'_>>, wanted: &str) {
        let title = format!("is a {}, wanted is {wanted}", value.get_ref().type_str());
        self.notes.add(value.span(), &self.key(key), title, format!("wanted is {wanted}"));
    }

    /// A number within bounds, in the unit that the key names.
    pub(super) fn number(&self, key: &str, range: RangeInclusive<f64>, unit: &str) -> f64 {
        let wanted = format!("a number from {} to {} {unit}", range.start(), range.end());
        let wanted = wanted.trim_end();
        let Some(value) = self.require(key, wanted) else { return *range.start() };
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().replace('_', "").parse::<f64>().ok(),
            DeValue::Integer(integer) if integer.radix() == 10 => {
                integer.as_str().replace('_', "").parse::<f64>().ok()
            }
            _ => None,
        };
        match number {
            // NaN is in no range.
            Some(number) if range.contains(&number) => number,
            Some(number) => {
                let title = format!("{number} {unit} is outside the allowed range");
                let title = title.replace("  ", " ");
                self.notes.add(value.span(), &self.key(key), title, format!("allowed is {wanted}"));
                *range.start()
            }
            None => {
                self.wrong_type(key, value, wanted);
                *range.start()
            }
        }
    }

    /// A whole number within bounds.
    pub(super) fn whole(&self, key: &str, range: RangeInclusive<i64>, unit: &str) -> i64 {
        let wanted = format!("a whole number from {} to {} {unit}", range.start(), range.end());
        let wanted = wanted.trim_end();
        let Some(value) = self.require(key, wanted) else { return *range.start() };
        let number = value.get_ref().as_integer().and_then(|integer| {
            i64::from_str_radix(&integer.as_str().replace('_', ""), integer.radix()).ok()
        });
        match number {
            Some(number) if range.contains(&number) => number,
            Some(number) => {
                let title = format!("{number} {unit} is outside the allowed range").replace("  ", " ");
                self.notes.add(value.span(), &self.key(key), title, format!("allowed is {wanted}"));
                *range.start()
            }
            None => {
                self.wrong_type(key, value, wanted);
                *range.start()
            }
        }
    }

    /// A text.
    pub(super) fn text(&self, key: &str) -> String {
        let Some(value) = self.require(key, "a text") else { return String::new() };
        match value.get_ref().as_str() {
            Some(text) => text.to_owned(),
            None => {
                self.wrong_type(key, value, "a text");
                String::new()
            }
        }
    }

    /// One of several words.
    pub(super) fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> T {
        let words: Vec<String> = choices.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        let wanted = format!("one of {}", words.join(", "));
        let Some(value) = self.require(key, &wanted) else { return choices[0].1 };
        let word = value.get_ref().as_str();
        match choices.iter().find(|(name, _)| Some(*name) == word) {
            Some((_, choice)) => *choice,
            None => {
                let title = match word {
                    Some(word) => format!("\"{word}\" is not known"),
                    None => format!("is a {}", value.get_ref().type_str()),
                };
                self.notes.add(value.span(), &self.key(key), title, format!("wanted is {wanted}"));
                choices[0].1
            }
        }
    }

    /// A table in here.
    pub(super) fn section(&self, key: &str) -> Self {
        let value = self.require(key, "a section");
        self.below(key, value)
    }

    /// A table in here that may be absent.
    pub(super) fn optional_section(&self, key: &str) -> Option<Self> {
        self.ask(key).map(|value| self.below(key, Some(value)))
    }

    fn below(&self, key: &str, value: Option<&'t Spanned<DeValue<'t>>>) -> Self {
        let table = value.and_then(|value| {
            let table = value.get_ref().as_table();
            if table.is_none() {
                self.wrong_type(key, value, "a section");
            }
            table
        });
        // An error about a section points at its header: its first key's line is where a person looks.
        let span = match (table, value) {
            (Some(_), Some(_)) => self
                .table
                .and_then(|outer| outer.get_key_value(key))
                .map_or(self.span.clone(), |(name, _)| name.span()),
            (_, Some(value)) => value.span(),
            (_, None) => self.span.clone(),
        };
        Self { notes: self.notes, table, span, path: self.key(key), asked: RefCell::default() }
    }

    /// All keys have been asked for: what is left is unknown.
    pub(super) fn close(self) {
        let asked = self.asked.borrow();
        for (name, _) in self.table.into_iter().flatten() {
            let key = name.get_ref().as_ref();
            if !asked.iter().any(|known| known == key) {
                let nearest = nearest(key, &asked);
                let label = match nearest {
                    Some(known) => format!("is `{known}` meant?"),
                    None => format!("known here: {}", asked.join(", ")),
                };
                self.notes.add(name.span(), &self.key(key), "unknown key", label);
            }
        }
    }
}

/// The known key that a typing slip would make of this one.
fn nearest<'k>(key: &str, known: &'k [String]) -> Option<&'k String> {
    known
        .iter()
        .map(|candidate| (strsim::levenshtein(key, candidate), candidate))
        .filter(|(edits, candidate)| *edits <= 2 + candidate.len() / 5)
        .min_by_key(|(edits, _)| *edits)
        .map(|(_, candidate)| candidate)
}
