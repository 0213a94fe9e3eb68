//! Which effect it is: the candidates of the shortlist are fitted together with the base, and each must pass every
//! gate before it is named.
//!
//! ```text
//!   base fit ─► shortlist ─► joint fits ─► gates ─► the best, with those that cannot be told from it ─► add ─┐
//!                  ▲                                                                                       │
//!                  └───────────────────────────────────────────────────────────────────────────────────────┘
//!   then backwards: each named effect must still be needed beside the others
//! ```
//!
//! Invariant: an effect that is named has passed every gate; one that has failed one is listed with it.

pub(super) mod base;
mod elsewhere;
mod look;
pub mod named;
mod near;
mod search;
mod stand;
mod staying;
mod told;

use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::refit::{base_refitted, is_noise};
use crate::offline::gap::fit::{Effort, fit, to_the_bottom};
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::shortlist::clocks;

use base::Base;
use named::Named;
use search::Search;
use stand::{Stand, exact};
use staying::without_little;

/// Most effects that are named of an axis.
const EFFECTS_MAX: usize = 4;

/// Names what an axis lacks beside its base; `progress` is told what is being done. With it the runs as they were weighed in the
/// end.
pub fn name<'m>(
    as_it_is: &Problem<'m>,
    mut base: Base<'m>,
    progress: &(dyn Fn(&str) + Sync),
) -> (Named, Problem<'m>) {
    let clocks_behind_s = clocks::behind_s(&base.problem, &base.coarse.model);
    let clocked = clocks_behind_s.as_ref().map(|behind_s| as_it_is.with_clocks(behind_s));
    if let Some(behind_s) = &clocks_behind_s {
        base.problem = base.problem.with_clocks(behind_s);
    }
    let mut search = Search::new(clocked.as_ref().unwrap_or(as_it_is), base, progress);
    while search.effects.len() < EFFECTS_MAX && search.looks() {}
    search.takes_back_what_is_open();
    search.goes_backwards();
    progress("fitting the base model to the end");
    let Search { start, coarse, mut stand, base, mut effects, mut refused, mut smallest, .. } = search;
    let mut base = match base {
        // Weighed as all that is compared with it.
        Some(base) => fit(&stand.problem, &base.model, Effort::Coarse(1), None),
        // What is noise is at its bottom, or nobody could tell, unless another model is held against it.
        None if is_noise(&stand.problem, &coarse)
            && !told::may_be_named(&stand.problem, &coarse, start.effects.len()) =>
        {
            coarse.clone()
        }
        None => to_the_bottom(&stand.problem, &coarse),
    };
    if effects.is_empty() {
        stand.move_to(base.clone());
    }
    let alone = Blocks::new(&stand.problem, &exact(&stand.model.model, &coarse.model));
    let Stand { problem, once, model, blocks } = stand;
    let told = told::told(&problem, &once, &model, [&blocks, &alone], [&start, &coarse.model]);
    if !told.named.is_empty() {
        let ends = [&base.model, &coarse.model].map(|of| of.without_all(&told.places));
        base = base_refitted(&problem, &once, ends.each_ref(), model.total, |_, _| false).0;
    }
    effects.extend(told.named);
    refused.extend(told.refused);
    let names: Vec<&str> = effects.iter().map(|named| named.name).collect();
    effects.iter_mut().for_each(|named| named.apart_from(&names));
    smallest.retain(|one| !names.contains(&one.name));
    let [base, model] = without_little(&problem, &mut effects, [base, told.model]);
    let (blocks, rows) = ([&base, &model].map(|of| Blocks::new(&problem, &of.model)), problem.counts());
    (Named { clocks_behind_s, base, model, blocks, effects, refused, smallest, rows }, problem)
}
