//! A search for what a model lacks, from one effect to the next: where it stands, and what it does in each round.
//!
//! ```text
//!   look ─► choose among what passed ─► put it to the test ─┬─► needed: it stays, and rows are weighed beside it
//!    ▲                                                      ├─► denied by its size alone: it stays if the next explains that
//!    │                                                      └─► not needed: back without it, from the deeper base it led to
//!    └──────────────────────────────────────────────────────────┘
//! ```
//!
//! Invariant: model, costs and rows that they are compared by stand in one place.

use tracing::debug;

use super::base::Base;
use super::look::Look;
use super::named::{NamedEffect, RunnerUp};
use super::near::{Near, Passed, margin, weighed};
use super::stand::{Stand, exact};
use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::louder::Louder;
use crate::offline::gap::fit::refit::{
    ITERATIONS, about, also_from, anew, another_way, beside, beyond_noise, coarsely_from, ended, explains,
    explains_much, refitted, unsettled,
};
use crate::offline::gap::fit::{Effort, Fitted, fit, to_the_bottom, total_of};
use crate::offline::gap::gates::candidate::Candidate;
use crate::offline::gap::gates::without::{Need, Without};
use crate::offline::gap::gates::{self, Gate};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::shortlist::smallest::Smallest;
use crate::offline::gap::shortlist::trials::InVain;

/// How often it goes on from a deeper place of the base to which an effect led that is not needed, and what is deeper: small
/// effects gain a thousandth of what is left.
const VALLEYS: usize = 2;
const DEEPER: f64 = 0.998;
/// An effect of whose gain the base makes so much by itself, once it has been led out of its valley, is asked for again from there.
const OF_BASE: f64 = 0.4;
/// What rows that judge deny is asked for once more, as rows count beside it, where it explains more than this share of what it leaves, or did
/// when it passed the gates. Less is not worth the time.
const ASKED_AGAIN: f64 = 5e-3;
/// An effect is held up in a valley where it leaves so much of what it gained, beyond noise.
const HELD_UP: f64 = 0.01;

/// What passed the gates, chosen.
struct Chosen {
    named: NamedEffect,
    /// The best of it at its bottom.
    bottom: Fitted,
    /// What it passed the gates with.
    evidence: f64,
}

/// What was chosen, put to the test.
struct Tested {
    /// The model without it.
    test: Without,
    need: Need,
    /// What speaks against it.
    lost: Option<Gate>,
}

/// A search on its way.
pub(super) struct Search<'s, 'm> {
    as_it_is: &'s Problem<'m>,
    progress: &'s (dyn Fn(&str) + Sync),
    /// As the machine file has it, with what nearly every axis has.
    filed: Model,
    /// What has one valley and was led by no stick and slip is where other ways begin.
    pub(in crate::offline::gap) start: Model,
    /// The base as it was fitted coarsely.
    pub(in crate::offline::gap) coarse: Fitted,
    pub(in crate::offline::gap) stand: Stand<'m>,
    /// The base at its bottom, which is known where a name was put to the test.
    pub(in crate::offline::gap) base: Option<Fitted>,
    pub(in crate::offline::gap) effects: Vec<NamedEffect>,
    pub(in crate::offline::gap) refused: Vec<Candidate>,
    pub(in crate::offline::gap) smallest: Vec<Smallest>,
    in_vain: InVain,
    /// How many effects that are not needed led it deeper, and whether the base went another way.
    valleys: usize,
    has_turned: bool,
    /// With the effect that led the base out of its valley, to be asked for again.
    leader: Option<Model>,
    /// How many effects it had when the size of the last was denied, and the model without that.
    open: Option<(usize, Without)>,
}

impl<'s, 'm> Search<'s, 'm> {
    /// From a base of these runs.
    pub(in crate::offline::gap) fn new(
        as_it_is: &'s Problem<'m>,
        Base { filed, problem, coarse, led }: Base<'m>,
        progress: &'s (dyn Fn(&str) + Sync),
    ) -> Self {
        Self {
            as_it_is,
            progress,
            filed,
            start: led,
            stand: Stand::at(problem, coarse.clone()),
            coarse,
            base: None,
            effects: Vec::new(),
            refused: Vec::new(),
            smallest: Vec::new(),
            in_vain: InVain::default(),
            valleys: 0,
            has_turned: false,
            leader: None,
            open: None,
        }
    }

    /// One effect more, or one less; whether it is worth another look.
    pub(in crate::offline::gap) fn looks(&mut self) -> bool {
        (self.progress)("looking for what is missing");
        let exact = exact(&self.stand.model.model, &self.coarse.model);
        let alone = Blocks::new(&self.stand.problem, &exact);
        let louder =
            Louder::for_what_is_left(&self.stand.problem, &self.stand.model.model, [&self.start, &exact]);
        let passed = self.passed(louder.as_ref(), &alone);
        if passed.is_empty() {
            return louder.is_some() && self.turns();
        }
        let chosen = self.chosen(passed, louder.as_ref(), &alone);
        self.tests(chosen, louder.is_some())
    }

    /// Where it looks: by noise as it is, or as loud as what is left.
    fn look<'l>(&'l self, louder: Option<&'l Louder<'m>>, alone: &'l Blocks) -> Look<'l, 'm> {
        let Stand { problem, once, model, blocks } = &self.stand;
        let (search, searched, at, judged) = match louder {
            Some(louder) => (&louder.problem, &louder.once, &louder.fitted, [&louder.blocks, &louder.alone]),
            None => (problem, once, model, [blocks, alone]),
        };
        Look { search, searched, at, judged }
    }

    /// What passes every gate, the best first.
    fn passed(&mut self, louder: Option<&Louder<'m>>, alone: &Blocks) -> Vec<Candidate> {
        let (in_vain, leader) = (std::mem::take(&mut self.in_vain), self.leader.take());
        let look = self.look(louder, alone);
        let mut in_vain = in_vain.beside(look.at.total);
        let (mut promising, seen) = look.promising(&mut in_vain, self.progress);
        // Where it leads to is known, and by a line from here it may not come there.
        if let Some(leader) = leader {
            promising
                .iter_mut()
                .for_each(|all| all.retain(|one| gates::last_of(one) != gates::last_of(&leader)));
            promising[0].push(leader);
        }
        // It is fitted to the bottom when it has been chosen. What comes beside what was named goes on from there: that tells which
        // valley it is, unless it left much.
        let refit = |model: &Model| {
            if self.effects.is_empty() || louder.is_some() {
                coarsely_from(look.search, look.searched, model, &self.start)
            } else {
                fit(look.search, &ended(look.searched, model), Effort::Coarse(ITERATIONS[0]), None)
            }
        };
        let mut candidates = look.tried(&promising, &refit);
        // By louder noise what is quiet gains nothing.
        self.in_vain = if louder.is_some() { InVain::default() } else { in_vain };
        self.smallest.retain(|before| seen.iter().all(|now| now.name != before.name));
        self.smallest.extend(seen);
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let (passed, failed) = candidates.into_iter().partition(|candidate| candidate.failed.is_empty());
        self.refused = failed;
        passed
    }

    /// The base by another way, if that leads plainly deeper.
    fn turns(&mut self) -> bool {
        if self.has_turned || !self.effects.is_empty() {
            return false;
        }
        (self.progress)("fitting the base model by another way");
        self.has_turned = true;
        let other = another_way(self.as_it_is, &self.start, (&self.stand.problem, &self.coarse));
        other.map(|(problem, coarse)| self.begin_at(problem, coarse)).is_some()
    }

    fn begin_at(&mut self, problem: Problem<'m>, coarse: Fitted) {
        self.stand = Stand::at(problem, coarse.clone());
        self.coarse = coarse;
    }

    /// The best of what passed, with what cannot be told from it.
    fn chosen(&self, passed: Vec<Candidate>, louder: Option<&Louder<'m>>, alone: &Blocks) -> Chosen {
        let Look { search, at, judged, .. } = self.look(louder, alone);
        let Stand { problem, once, model, .. } = &self.stand;
        let rows = problem.count(Part::Fit);
        let best = passed[0].clone();
        let (best_name, numbers, margin) = (best.name(), best.fitted.model.numbers(), margin(best.evidence));
        let Passed { mut near, rest, least } = Passed::of(passed, rows, louder.is_some());
        // What is far was fitted by all ways already.
        let bottom_of = |Candidate { fitted, .. }: &Candidate| {
            let bottom = if self.effects.is_empty() && !explains_much(fitted, at) {
                refitted(problem, once, &fitted.model, &self.start)
            } else {
                to_the_bottom(problem, fitted)
            };
            // Louder noise does not tell which of its laws it follows.
            let laws = louder.iter().flat_map(|_| bottom.model.by_other_laws());
            let elsewhere =
                bottom.model.with_falls_exchanged().into_iter().chain(bottom.model.with_last_over_sooner());
            let others: Vec<Model> = laws.chain(elsewhere).collect();
            also_from(problem, bottom, &others)
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
        (self.progress)(&format!("{best_name}: is it needed?"));
        // So may what changes much the same with a number less, or as many where nothing was named before: it begins from its bottom, for a few
        // steps do not lead there.
        let most = if self.effects.is_empty() { numbers } else { numbers - 1 };
        let is_no_more = |other: &Model| other.numbers() <= most && other.last_effect() != Some(best_name);
        if best.fitted.model.with_last_as_alike().any(|other| is_no_more(&other)) {
            let bottom = bottom_of(&near[0]);
            let alike: Vec<Model> = bottom.model.with_last_as_alike().filter(is_no_more).collect();
            if alike.iter().any(|other| other.numbers() < numbers) {
                near[0].fitted = bottom;
            }
            near.extend(alike.iter().map(|other| as_near(fit(problem, other, Effort::Fine, None))));
        }
        let held = |fitted: &Fitted| Blocks::new(problem, &fitted.model).cost();
        let Near { mut class, model: bottom, told_apart } =
            Near::of((near, least), &bottom_of, &held, model, rows);
        let best = class[0].clone();
        let next = rest.first().or(self.refused.first());
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
        class.extend(self.refused.iter().filter(is_beyond).cloned());
        let named = NamedEffect { name: best.name(), class: weighed(class, margin), runner_up };
        Chosen { named, bottom, evidence: best.evidence }
    }

    /// On its way to the last effect the base may have left a valley in which the fit without it was held up: what is
    /// gained is what is lost again without it, from where it stands.
    fn put_to_the_test(&self, stand: &Stand<'m>) -> Tested {
        let Stand { problem, once, model, blocks } = stand;
        let (test, need) =
            Without::of_last(problem, once, (model, blocks), [&self.start, &self.coarse.model]);
        let lost = gates::lost_at(problem, model).or((need == Need::None).then_some(Gate::Needed));
        Tested { test, need, lost }
    }

    /// Goes on with what was chosen if it passes the test; whether it is worth another look.
    fn tests(&mut self, Chosen { named, bottom, evidence }: Chosen, is_louder: bool) -> bool {
        let (is_first, name) = (self.effects.is_empty(), named.name);
        let mut before = self.stand.model.clone();
        self.stand.move_to(bottom);
        self.effects.push(named);
        let mut tested = self.put_to_the_test(&self.stand);
        // Rows that judge may deny it as they count, and as noise moves means, about a base that lacks it.
        let is_worth_it = explains(ASKED_AGAIN, &self.stand.model, &tested.test.fitted)
            || evidence > ASKED_AGAIN * self.stand.problem.count(Part::Fit) as f64;
        if tested.lost == Some(Gate::Needed) && is_worth_it {
            let near = beside(&self.stand.problem, &self.stand.model.model);
            let other = to_the_bottom(&near, &self.stand.model);
            let other = Stand::at(near, other);
            let again = self.put_to_the_test(&other);
            if again.lost.is_none() {
                (tested, self.stand) = (again, other);
                let Stand { problem, model, .. } = &self.stand;
                before.total = total_of(problem, &before.model);
                if let Some(last) = self.effects.last_mut() {
                    last.tell_apart(problem, model, tested.test.fitted.total - model.total);
                }
            }
        }
        let Tested { test, need, lost } = tested;
        if is_first {
            self.base = Some(test.fitted.clone());
        }
        let [gained, of_base] = [&self.stand.model, &test.fitted].map(|fitted| before.total - fitted.total);
        debug!(name, gained, of_base, ?need, ?lost, "put to the test");
        let is_deeper = test.fitted.total < DEEPER * before.total;
        let is_of_base = is_first && is_deeper && of_base > OF_BASE * gained && self.valleys < VALLEYS;
        if let Some(gate) = lost.or(is_of_base.then_some(Gate::Needed)) {
            self.leader = lost.is_none().then(|| self.stand.model.model.clone());
            self.take_back(gate, test);
            return is_deeper && self.goes_on_deeper();
        }
        if need == Need::OfAnotherSize {
            // What it leaves bends its size: it stays if something explains that.
            self.open = Some((self.effects.len(), test));
        } else if let Some(about) = unsettled(&self.stand.problem, &self.stand.model) {
            (self.progress)(&format!("{name}: how large is it?"));
            // The base had gone far to make up for it, and stands in no valley that it would find with the effect.
            let is_far = is_louder || before.model.has_gone_far();
            self.settle(about, is_far.then_some(gained));
        }
        true
    }

    /// Fits what was named where rows count, and noise moves means, about it: so far they did about the base alone. Beside a base that was
    /// far, it is begun anew for what it has gained.
    fn settle(&mut self, about: Problem<'m>, gained_far: Option<f64>) {
        self.stand.once = about.first_passes();
        self.stand.problem = about;
        let Stand { problem, once, model, .. } = &self.stand;
        let model = if self.effects.len() == 1 {
            refitted(problem, once, &model.model, &self.start)
        } else {
            to_the_bottom(problem, model)
        };
        // Where hardly more than noise is left, no other way is missed.
        let other = gained_far
            .filter(|gained| beyond_noise(problem, &model) > HELD_UP * gained)
            .and_then(|_| anew(self.as_it_is, &model.model, &self.filed))
            .filter(|(_, other)| total_of(problem, &other.model) < model.total);
        match other {
            Some((near, other)) => self.stand = Stand::at(near, other),
            None => self.stand.move_to(model),
        }
    }

    /// Without the effect that was named last, which a gate refused.
    fn take_back(&mut self, gate: Gate, test: Without) {
        self.refused.extend(self.effects.pop().and_then(|last| last.refused_by(gate)));
        self.stand.go_without(test);
    }

    /// An effect that is not needed only led the base out of its valley: what came before may have been the next best way out of it, and
    /// what is missing may not have shown in it. Whether it is worth another look from here.
    fn goes_on_deeper(&mut self) -> bool {
        while !self.effects.is_empty() {
            let Tested { test, lost, .. } = self.put_to_the_test(&self.stand);
            if self.effects.len() == 1 {
                self.base = Some(test.fitted.clone());
            }
            let Some(gate) = lost else { break };
            self.take_back(gate, test);
        }
        self.valleys += 1;
        if self.valleys > VALLEYS {
            return false;
        }
        if self.effects.is_empty() {
            // About another base noise moves the mean in another way.
            let (problem, coarse) = about(&self.stand.problem, &self.stand.model.model);
            self.begin_at(problem, coarse);
            self.base = None;
        }
        true
    }

    /// Nothing further explains what denies an effect its size.
    pub(super) fn takes_back_what_is_open(&mut self) {
        if let Some((_, test)) = self.open.take().filter(|(place, _)| *place == self.effects.len()) {
            self.take_back(Gate::Judged, test);
        }
    }

    /// Backwards: what came first may have stood for what came later.
    pub(super) fn goes_backwards(&mut self) {
        let (usual, mut place) = (self.start.effects.len(), 0);
        while self.effects.len() > 1 && place + 1 < self.effects.len() {
            let Stand { problem, once, model, blocks } = &self.stand;
            let bases = [&self.start, &self.coarse.model];
            let test = Without::of(problem, once, model, usual + place, bases);
            let is_at_bound = model.is_at_bound(usual + place);
            let has_shrunk = self.effects[place].has_shrunk(&model.model.effects[usual + place]);
            if !is_at_bound && !has_shrunk && test.shows_need(problem, model, blocks, usual + place) {
                place += 1;
            } else {
                self.effects.remove(place);
                self.stand.go_without(test);
                place = 0;
            }
        }
    }
}
