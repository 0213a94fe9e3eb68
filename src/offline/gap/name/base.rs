//! The base of an axis that a search begins with: fitted to its runs without any effect but what nearly every axis has.
//!
//! Invariant: runs and base belong together, as rows count there.

use crate::offline::gap::fit::Fitted;
use crate::offline::gap::fit::refit::coarsely;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::usual;

/// The base that a search begins with.
pub struct Base<'m> {
    /// As the machine file has it, with what nearly every axis has.
    pub(in crate::offline::gap) filed: Model,
    /// The runs, where rows count by how straight the fitted one is about them.
    pub(in crate::offline::gap) problem: Problem<'m>,
    /// It is fitted coarsely.
    pub(in crate::offline::gap) coarse: Fitted,
    /// Where rows in motion led.
    pub(in crate::offline::gap) led: Model,
}

impl<'m> Base<'m> {
    /// Of a machine file, fitted to runs; `progress` is told what is being done.
    pub fn of(as_it_is: &Problem<'m>, start: &Model, progress: &(dyn Fn(&str) + Sync)) -> Self {
        progress("fitting the base model");
        let filed = usual::with(start);
        let (problem, coarse, led) = coarsely(as_it_is, &filed);
        Self { filed, problem, coarse, led }
    }
}
