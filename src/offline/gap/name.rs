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

use tracing::debug;

use super::blocks::Blocks;
use super::candidate::Candidate;
use super::clocks;
use super::fit::{Effort, Fitted, fit, to_the_bottom, total_of};
use super::gates::{self, Gate};
use super::little::without_little;
use super::look::Look;
use super::louder::Louder;
use super::model::Model;
use super::named::{Named, NamedEffect, RunnerUp, is_alias};
use super::near::{
    Near, explains_as_much, explains_roughly_as_much, is_with_less, margin, price_of_a_number, weighed,
};
use super::problem::{Part, Problem};
use super::refit::{
    ITERATIONS, about, also_from, anew, another_way, base_refitted, beside, coarsely, coarsely_from, ended,
    explains, explains_much, is_noise, refitted, unsettled,
};
use super::smallest::Smallest;
use super::trials::InVain;
use super::usual;
use super::without::{Need, Without};

/// Most effects that are named of an axis.
const EFFECTS_MAX: usize = 4;
/// How often the search goes on from a deeper place of the base to which an effect led that is not needed, and what is deeper: small
/// effects gain a thousandth of what is left.
const VALLEYS: usize = 2;
const DEEPER: f64 = 0.998;
/// An effect of whose gain the base makes so much by itself, once it has been led out of its valley, is asked for again from there.
const OF_BASE: f64 = 0.4;
/// What rows that judge deny is asked for once more, as rows count beside it, where it explains more than this share of what it leaves, or did
/// when it passed the gates. Less is not worth the time.
const ASKED_AGAIN: f64 = 5e-3;

/// The base that a search begins with.
pub struct Base<'m> {
    /// As the machine file has it, with what nearly every axis has.
    filed: Model,
    /// The runs, where rows count by how straight the fitted one is about them.
    problem: Problem<'m>,
    /// It is fitted coarsely.
    pub(super) coarse: Fitted,
    /// Where rows in motion led.
    led: Model,
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

/// Names what an axis lacks beside its base; `progress` is told what is being done. With it the runs as they were weighed in the
/// end.
pub fn name<'m>(
    as_it_is: &Problem<'m>,
    Base { filed, mut problem, mut coarse, led }: Base<'m>,
    progress: &(dyn Fn(&str) + Sync),
) -> (Named, Problem<'m>) {
    // What has one valley and was led by no stick and slip is where other ways begin.
    let (start, usual) = (&led, led.effects.len());
    let clocks_behind_s = clocks::behind_s(&problem, &coarse.model);
    let clocked = clocks_behind_s.as_ref().map(|behind_s| as_it_is.with_clocks(behind_s));
    let as_it_is = clocked.as_ref().unwrap_or(as_it_is);
    if let Some(behind_s) = &clocks_behind_s {
        problem = problem.with_clocks(behind_s);
    }
    let (mut once, mut model, mut blocks) = begun(&problem, &coarse);
    // The base at its bottom, which is known where a name was put to the test.
    let mut base: Option<Fitted> = None;
    let (mut valleys, mut has_turned) = (0, false);
    // With the effect that led the base out of its valley, to be asked for again.
    let mut leader: Option<Model> = None;
    let mut effects: Vec<NamedEffect> = Vec::new();
    let (mut refused, mut smallest) = (Vec::new(), Vec::<Smallest>::new());
    let mut in_vain = InVain::default();
    let mut open: Option<(usize, Without)> = None;
    while effects.len() < EFFECTS_MAX {
        progress("looking for what is missing");
        let exact = but_for_inexact(&model.model, &coarse.model);
        let alone = Blocks::new(&problem, &exact);
        let louder = Louder::for_what_is_left(&problem, &model.model, [start, &exact]);
        let (search, searched, at, judged) = match &louder {
            Some(louder) => (&louder.problem, &louder.once, &louder.fitted, [&louder.blocks, &louder.alone]),
            None => (&problem, &once, &model, [&blocks, &alone]),
        };
        let look = Look { search, searched, at, judged };
        in_vain = in_vain.beside(at.total);
        let (mut promising, seen) = look.promising(&mut in_vain, progress);
        // By louder noise what is quiet gains nothing.
        if louder.is_some() {
            in_vain = InVain::default();
        }
        smallest.retain(|before| seen.iter().all(|now| now.name != before.name));
        smallest.extend(seen);
        // Where it leads to is known, and by a line from here it may not come there.
        if let Some(leader) = leader.take() {
            promising
                .iter_mut()
                .for_each(|all| all.retain(|one| gates::last_of(one) != gates::last_of(&leader)));
            promising[0].push(leader);
        }
        let is_first = effects.is_empty();
        // It is fitted to the bottom when it has been chosen. What comes beside what was named goes on from there: that tells which
        // valley it is, unless it left much.
        let refit = |model: &Model| {
            if is_first || louder.is_some() {
                coarsely_from(search, searched, model, start)
            } else {
                fit(search, &ended(searched, model), Effort::Coarse(ITERATIONS[0]), None)
            }
        };
        let mut candidates = look.tried(&promising, &refit);
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let (passed, failed): (Vec<Candidate>, Vec<Candidate>) =
            candidates.into_iter().partition(|candidate| candidate.failed.is_empty());
        refused = failed;
        let Some(best) = passed.first() else {
            if louder.is_none() || !is_first || has_turned {
                break;
            }
            progress("fitting the base model by another way");
            has_turned = true;
            let Some(other) = another_way(as_it_is, start, (&problem, &coarse)) else { break };
            (problem, coarse) = other;
            (once, model, blocks) = begun(&problem, &coarse);
            continue;
        };
        let (best_name, margin) = (best.name(), margin(best.evidence));
        let rows = problem.count(Part::Fit);
        // What says no more with more numbers is no other explanation.
        let count = |candidate: &Candidate| candidate.fitted.model.numbers();
        let (least, most) = (best.evidence - margin, count(best));
        let doubted = best.evidence - price_of_a_number(best.fitted.cost, rows);
        let best = best.clone();
        let (mut near, rest): (Vec<Candidate>, Vec<Candidate>) = passed.into_iter().partition(|candidate| {
            let is_as_good = candidate.evidence > least || explains_as_much(candidate, &best, rows);
            let is_near = is_as_good && count(candidate) <= most;
            let is_less =
                candidate.evidence > doubted && is_with_less(&candidate.fitted.model, &best.fitted.model);
            let is_roughly = explains_roughly_as_much(candidate, &best, louder.is_some());
            is_near || is_less || is_roughly || is_alias(best_name, candidate.name())
        });
        // What is far was fitted by all ways already.
        let bottom_of = |Candidate { fitted, .. }: &Candidate| {
            let bottom = if is_first && !explains_much(fitted, at) {
                refitted(&problem, &once, &fitted.model, start)
            } else {
                to_the_bottom(&problem, fitted)
            };
            // Louder noise does not tell which of its laws it follows.
            let laws = louder.iter().flat_map(|_| bottom.model.by_other_laws());
            let others: Vec<Model> = laws.chain(bottom.model.with_falls_exchanged()).collect();
            also_from(&problem, bottom, &others)
        };
        // What holds for the best holds for what is near it.
        let as_near =
            |fitted: Fitted| Candidate { failed: Vec::new(), ..gates::judged(search, at, judged, fitted) };
        // Its twin may have been left behind on the way.
        let twin = near[0].fitted.with_last_as_its_twin().filter(|_| problem.has_table());
        let is_there = |twin: &Model| near.iter().any(|one| Some(one.name()) == gates::last_of(twin));
        if let Some(twin) = twin.filter(|twin| !is_there(twin)) {
            near.push(as_near(fit(search, &twin, Effort::Coarse(ITERATIONS[1]), None)));
        }
        progress(&format!("{best_name}: is it needed?"));
        // So may what it is with a number less, which begins from its bottom: a few steps do not lead there.
        let has_less =
            |other: &Model| other.numbers() < count(&best) && other.last_effect() != Some(best_name);
        if best.fitted.model.with_last_as_alike().any(|other| has_less(&other)) {
            near[0].fitted = bottom_of(&near[0]);
            let less: Vec<Model> = near[0].fitted.model.with_last_as_alike().filter(has_less).collect();
            near.extend(less.iter().map(|less| as_near(fit(&problem, less, Effort::Fine, None))));
        }
        let held = |fitted: &Fitted| Blocks::new(&problem, &fitted.model).cost();
        let Near { mut class, model: bottom, told_apart } =
            Near::of((near, least), &bottom_of, &held, &model, rows);
        let best = class[0].clone();
        let next = rest.first().or(refused.first());
        let runner_up = told_apart.or(next.map(|next| RunnerUp {
            name: next.name(),
            behind: best.evidence - next.evidence,
            failed: next.failed.clone(),
            is_as_good: false,
        }));
        // What explains more and has odd values makes the best no sure name.
        let is_beyond = |one: &&Candidate| {
            one.is_doubtful() && !one.is_on_its_way_to(&best) && one.evidence > best.evidence + margin
        };
        class.extend(refused.iter().filter(is_beyond).cloned());
        let class = weighed(class, margin);
        let mut before = std::mem::replace(&mut model, bottom);
        blocks = Blocks::new(&problem, &model.model);
        effects.push(NamedEffect { name: best.name(), class, runner_up });
        // On its way to the effect the base may have left a valley in which the fit without it was held up: what is
        // gained is what is lost again without it, from here.
        let put_to_the_test = |problem: &Problem<'m>, once: &Problem<'m>, model: &Fitted, blocks: &Blocks| {
            let (test, need) = Without::of_last(problem, once, (model, blocks), [start, &coarse.model]);
            let lost = gates::lost_at(problem, model).or((need == Need::None).then_some(Gate::Needed));
            (test, need, lost)
        };
        let (mut test, mut need, mut lost) = put_to_the_test(&problem, &once, &model, &blocks);
        // Rows that judge may deny it as they count, and as noise moves means, about a base that lacks it.
        let is_worth_it =
            explains(ASKED_AGAIN, &model, &test.fitted) || best.evidence > ASKED_AGAIN * rows as f64;
        if lost == Some(Gate::Needed) && is_worth_it {
            let near = beside(&problem, &model.model);
            let (near_once, other) = (near.first_passes(), to_the_bottom(&near, &model));
            let of_other = Blocks::new(&near, &other.model);
            let again = put_to_the_test(&near, &near_once, &other, &of_other);
            if again.2.is_none() {
                (test, need, lost) = again;
                (problem, once, model, blocks) = (near, near_once, other, of_other);
                before.total = total_of(&problem, &before.model);
                if let Some(last) = effects.last_mut() {
                    last.tell_apart(&problem, &model, test.fitted.total - model.total);
                }
            }
        }
        if is_first {
            base = Some(test.fitted.clone());
        }
        let [gained, of_base] = [&model, &test.fitted].map(|fitted| before.total - fitted.total);
        debug!(name = best.name(), gained, of_base, ?need, ?lost, "put to the test");
        let is_deeper = test.fitted.total < DEEPER * before.total;
        let is_of_base = is_first && is_deeper && of_base > OF_BASE * gained && valleys < VALLEYS;
        if let Some(gate) = lost.or(is_of_base.then_some(Gate::Needed)) {
            leader = lost.is_none().then(|| model.model.clone());
            (model, blocks) = taken_back((&mut effects, &mut refused), gate, test);
            // It only led the base out of its valley: what came before may have been the next best way out of it, and
            // what is missing may not have shown in it.
            while is_deeper && !effects.is_empty() {
                let (test, _, lost) = put_to_the_test(&problem, &once, &model, &blocks);
                if effects.len() == 1 {
                    base = Some(test.fitted.clone());
                }
                let Some(gate) = lost else { break };
                (model, blocks) = taken_back((&mut effects, &mut refused), gate, test);
            }
            valleys += 1;
            if !is_deeper || valleys > VALLEYS {
                break;
            }
            if effects.is_empty() {
                // About another base noise moves the mean in another way.
                (problem, coarse) = about(&problem, &model.model);
                (once, model, blocks) = begun(&problem, &coarse);
                base = None;
            }
        } else if need == Need::OfAnotherSize {
            // What it leaves bends its size: it stays if something explains that.
            open = Some((effects.len(), test));
        } else if let Some(about) = unsettled(&problem, &model) {
            progress(&format!("{}: how large is it?", best.name()));
            // Rows weigh by where the base alone is straight, and noise moves means about it: beside an effect they do otherwise.
            problem = about;
            once = problem.first_passes();
            model = if is_first {
                refitted(&problem, &once, &model.model, start)
            } else {
                to_the_bottom(&problem, &model)
            };
            // The base had gone far to make up for it, and stands in no valley that it would find with the effect, unless only noise is left.
            let is_far = louder.is_some() || before.model.has_gone_far();
            if is_far && !is_noise(&problem, &model) {
                let (near, other) = anew(as_it_is, &model.model, &filed);
                if total_of(&problem, &other.model) < model.total {
                    (once, problem, model) = (near.first_passes(), near, other);
                }
            }
            blocks = Blocks::new(&problem, &model.model);
        }
    }
    if let Some((_, test)) = open.filter(|(place, _)| *place == effects.len()) {
        (model, blocks) = taken_back((&mut effects, &mut refused), Gate::Judged, test);
    }
    // Backwards: what came first may have stood for what came later.
    let mut place = 0;
    while effects.len() > 1 && place + 1 < effects.len() {
        let test = Without::of(&problem, &once, &model, usual + place, [start, &coarse.model]);
        let is_at_bound = model.is_at_bound(usual + place);
        if !is_at_bound && test.shows_need(&problem, &model, &blocks, usual + place) {
            place += 1;
        } else {
            effects.remove(place);
            (model, blocks) = (test.fitted, test.blocks);
            place = 0;
        }
    }
    progress("fitting the base model to the end");
    let mut base = match base {
        // Weighed as all that is compared with it.
        Some(base) => fit(&problem, &base.model, Effort::Coarse(1), None),
        // What is noise is at its bottom, or nobody could tell, unless another model is held against it.
        None if is_noise(&problem, &coarse) && !usual::may_be_named(&problem, &coarse, usual) => {
            coarse.clone()
        }
        None => to_the_bottom(&problem, &coarse),
    };
    if effects.is_empty() {
        (model, blocks) = (base.clone(), Blocks::new(&problem, &base.model));
    }
    let alone = Blocks::new(&problem, &but_for_inexact(&model.model, &coarse.model));
    let told = usual::told(&problem, &once, &model, [&blocks, &alone], [start, &coarse.model]);
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

/// What a search begins with at a base: each command once, the base as the model, and its blocks.
fn begun<'m>(problem: &Problem<'m>, coarse: &Fitted) -> (Problem<'m>, Fitted, Blocks) {
    (problem.first_passes(), coarse.clone(), Blocks::new(problem, &coarse.model))
}

/// The base, or a model without all that its effects may explain wrong: a further one is held against what they do.
fn but_for_inexact(model: &Model, base: &Model) -> Model {
    let is_exact = |place: &usize| model.effects[*place].entry.is_of_gains();
    let (exact, others): (Vec<usize>, Vec<usize>) =
        (base.effects.len()..model.effects.len()).partition(is_exact);
    if exact.is_empty() { base.clone() } else { model.without_all(&others) }
}

/// A model and its blocks without the effect that was named last, which a gate refused.
fn taken_back(
    (effects, refused): (&mut Vec<NamedEffect>, &mut Vec<Candidate>),
    gate: Gate,
    test: Without,
) -> (Fitted, Blocks) {
    refused.extend(effects.pop().and_then(|last| last.refused_by(gate)));
    (test.fitted, test.blocks)
}

#[cfg(test)]
mod tests {
    use super::super::model::Tried;
    use super::*;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn a_further_effect_is_held_against_what_may_be_wrong_of_those_before_it() {
        let base = Model::new(paper_axis());
        let of = |names: &[&'static str]| {
            names.iter().fold(base.clone(), |model, name| {
                let entry = entry(name).expect("an effect");
                model.with(Tried { entry, values: entry.nominal() })
            })
        };
        for (named, exact) in [
            (&["servo-gain-mismatch", "presliding"][..], &["servo-gain-mismatch"][..]),
            (&["servo-gain-mismatch"], &["servo-gain-mismatch"]),
            // A filter may be of another order, and a pulse of another shape.
            (&["command-filter"], &[]),
            (&["reversal-compensation", "presliding"], &[]),
            (&[], &[]),
        ] {
            let left = but_for_inexact(&of(named), &base);
            let left: Vec<&str> = left.effects.iter().map(|tried| tried.entry.name).collect();
            assert_eq!(left, exact, "{named:?}");
        }
    }
}
