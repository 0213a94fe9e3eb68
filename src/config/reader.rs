//! Reads a TOML text section by section, noting every problem instead of stopping at the first.
//!
//! A [`Section`] hands out values by key with unit and range, remembers which keys were asked for, and
//! names the rest as unknown when it is closed. After a problem a harmless value stands in, so that
//! reading goes on; nothing read from a text with problems leaves `config`.
//! Invariant: a key that is not asked for is a problem; there are no silent defaults.

use std::cell::RefCell;
use std::ops::{Range, RangeInclusive};

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

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

    /// Whether nothing is wrong with the value at a full path, inside it or around it.
    fn is_sound(&self, path: &str) -> bool {
        let is_within = |inner: &str, outer: &str| {
            inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        self.problems
            .borrow()
            .iter()
            .all(|problem| !is_within(path, &problem.key) && !is_within(&problem.key, path))
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

/// Parse a text. Where its grammar is broken, only that is told: what a section or value would be is a
/// guess there, and problems of guesses mislead.
pub(super) fn parse<'t>(file: &str, text: &'t str) -> Result<Spanned<DeTable<'t>>, FileProblems> {
    let (table, errors) = DeTable::parse_recoverable(text);
    let notes = Notes::default();
    for error in errors {
        let span = error.span().unwrap_or(0..0);
        notes.add(span, "TOML", error.message(), "not understood here");
    }
    notes.into_result(file, text, table)
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

    /// Note that the value of a key is not right, whatever the others are.
    pub(super) fn object(&self, key: &str, title: impl Into<String>, label: impl Into<String>) {
        self.notes.add(self.span_of(key), &self.key(key), title, label);
    }

    /// Note that the value at a path (`limits.current-a`) does not fit with those at others. Nothing is
    /// noted when one of them is missing or has a problem of its own: what stands in for it proves nothing.
    pub(super) fn conflict(
        &self,
        path: &str,
        others: &[&str],
        title: impl Into<String>,
        label: impl Into<String>,
    ) {
        let mut paths = others.iter().chain([&path]);
        if paths.all(|path| self.find(path).is_ok() && self.notes.is_sound(&self.key(path))) {
            self.notes.add(self.span_of(path), &self.key(path), title, label);
        }
    }

    /// Where the value at a path stands, or the innermost section around it.
    fn span_of(&self, path: &str) -> Range<usize> {
        self.find(path).unwrap_or_else(|around| around)
    }

    /// Where the value at a path stands; the innermost section around it where there is none.
    fn find(&self, path: &str) -> Result<Range<usize>, Range<usize>> {
        let (mut table, mut span) = (self.table, self.span.clone());
        for key in path.split('.') {
            let Some((name, value)) = table.and_then(|table| table.get_key_value(key)) else {
                return Err(span);
            };
            table = value.get_ref().as_table();
            // A section is pointed at by its header.
            span = if table.is_some() { name.span() } else { value.span() };
        }
        Ok(span)
    }

    /// Names of the keys in here, in order of the text.
    pub(super) fn keys(&self) -> Vec<String> {
        self.keys_of("")
    }

    /// Names of the keys in the table at a path, in order of the text; none where there is no table.
    pub(super) fn keys_of(&self, path: &str) -> Vec<String> {
        let steps = path.split('.').filter(|key| !key.is_empty());
        let table = steps.fold(self.table, |table, key| table?.get(key)?.get_ref().as_table());
        let mut keys: Vec<_> = table.into_iter().flat_map(|table| table.keys()).collect();
        keys.sort_by_key(|key| key.span().start);
        keys.into_iter().map(|key| key.get_ref().to_string()).collect()
    }

    /// Let a key pass that was noted otherwise, or know one that is not there.
    pub(super) fn skip(&self, key: &str) {
        self.ask(key);
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
        let (shown, kind) = (shown(value.get_ref()), value.get_ref().type_str());
        let title = format!("{shown} is of type {kind}");
        self.notes.add(value.span(), &self.key(key), title.trim_start(), format!("wanted is {wanted}"));
    }

    fn out_of_range(&self, key: &str, value: &Spanned<DeValue<'_>>, number: &str, unit: &str, wanted: &str) {
        let number = format!("{number} {unit}");
        let title = format!("{} is outside the allowed range", number.trim_end());
        self.notes.add(value.span(), &self.key(key), title, format!("allowed is {wanted}"));
    }

    /// A number within bounds, in the unit that the key names.
    pub(super) fn number(&self, key: &str, range: RangeInclusive<f64>, unit: &str) -> f64 {
        let wanted = format!("a number from {} to {} {unit}", range.start(), range.end());
        let wanted = wanted.trim_end();
        let Some(value) = self.require(key, wanted) else { return *range.start() };
        match decimal(value.get_ref()) {
            // NaN is in no range.
            Some(number) if range.contains(&number) => number,
            Some(number) => {
                self.out_of_range(key, value, &number.to_string(), unit, wanted);
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
        let Some(integer) = value.get_ref().as_integer() else {
            self.wrong_type(key, value, wanted);
            return *range.start();
        };
        // What is too long for an i64 is in no range.
        let digits = integer.as_str().replace('_', "");
        match i64::from_str_radix(&digits, integer.radix()) {
            Ok(number) if range.contains(&number) => number,
            Ok(number) => {
                self.out_of_range(key, value, &number.to_string(), unit, wanted);
                *range.start()
            }
            Err(_) => {
                self.out_of_range(key, value, &digits, unit, wanted);
                *range.start()
            }
        }
    }

    /// A whole number within bounds that may be absent.
    pub(super) fn optional_whole(&self, key: &str, range: RangeInclusive<i64>, unit: &str) -> Option<i64> {
        if self.value(key).is_some() {
            return Some(self.whole(key, range, unit));
        }
        self.skip(key);
        None
    }

    /// A number within bounds that may be absent.
    pub(super) fn optional_number(&self, key: &str, range: RangeInclusive<f64>, unit: &str) -> Option<f64> {
        if self.value(key).is_some() {
            return Some(self.number(key, range, unit));
        }
        self.skip(key);
        None
    }

    /// A pair of numbers around a value that may be absent.
    pub(super) fn optional_interval(&self, key: &str, around: f64, unit: &str) {
        let Some(value) = self.ask(key) else { return };
        let wanted = format!("[low, high] around {around} {unit}");
        let numbers = |items: &DeArray<'_>| items.iter().map(|item| decimal(item.get_ref())).collect();
        let ends: Option<Vec<f64>> = value.get_ref().as_array().and_then(numbers);
        match ends.as_deref() {
            Some([low, high]) if (*low..=*high).contains(&around) => {}
            Some([low, high]) => {
                let title = format!("{low} to {high} {unit} does not contain the value");
                self.notes.add(value.span(), &self.key(key), title, format!("wanted is {wanted}"));
            }
            _ => self.wrong_type(key, value, &wanted),
        }
    }

    /// A text that may be absent.
    pub(super) fn optional_text(&self, key: &str) -> Option<String> {
        if self.value(key).is_some() {
            return Some(self.text(key));
        }
        self.skip(key);
        None
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
                match word {
                    Some(word) => {
                        let title = format!("{word:?} is not known");
                        self.notes.add(value.span(), &self.key(key), title, format!("wanted is {wanted}"));
                    }
                    None => self.wrong_type(key, value, &wanted),
                }
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

    /// A table that is not there, as was noted elsewhere.
    pub(super) fn absent(&self, key: &str) -> Self {
        self.below(key, None)
    }

    /// The tables of an array in here, in order of the text; none where it is absent.
    pub(super) fn sections(&self, key: &str) -> Vec<Self> {
        let Some(value) = self.ask(key) else { return Vec::new() };
        let Some(tables) = value.get_ref().as_array() else {
            self.wrong_type(key, value, "an array of sections");
            return Vec::new();
        };
        let place = |(index, table): (usize, &'t Spanned<DeValue<'t>>)| Self {
            span: table.span(),
            ..self.below(&format!("{key}[{index}]"), Some(table))
        };
        tables.iter().enumerate().map(place).collect()
    }

    fn below(&self, key: &str, value: Option<&'t Spanned<DeValue<'t>>>) -> Self {
        let table = value.and_then(|value| {
            let table = value.get_ref().as_table();
            if table.is_none() {
                self.wrong_type(key, value, "a section");
            }
            table
        });
        Self {
            notes: self.notes,
            table,
            span: self.span_of(key),
            path: self.key(key),
            asked: RefCell::default(),
        }
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

/// A number, whole or not.
fn decimal(value: &DeValue<'_>) -> Option<f64> {
    let digits = match value {
        DeValue::Float(float) => float.as_str(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str(),
        _ => return None,
    };
    digits.replace('_', "").parse().ok()
}

/// A value as a person wrote it; nothing for what has an inside.
fn shown(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("{text:?}"),
        DeValue::Integer(integer) => integer.to_string(),
        DeValue::Float(float) => float.as_str().to_owned(),
        DeValue::Boolean(is_true) => is_true.to_string(),
        DeValue::Datetime(_) | DeValue::Array(_) | DeValue::Table(_) => String::new(),
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
