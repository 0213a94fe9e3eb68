//! Differential evolution: a genetic algorithm on real numbers, for one objective or several, with constraints.
//!
//! GDE3 of Kukkonen and Lampinen (CEC 2005, pp. 443-450). Each member of the population is challenged by a trial,
//! crossed with it (`DE/rand/1/bin` of Storn and Price): the best of three others plus a scaled difference of the
//! two that remain (Kaelo and Ali, European Journal of Operational Research 169, 2006):
//!
//! ```text
//!   trial better ──► it takes the member's place        member better ──► it stays
//!   neither      ──► both stay, until the population is cut back: best fronts first, then the least crowded
//! ```
//!
//! Better is, by Deb's rules: what keeps all constraints before what breaks some, then what breaks them less;
//! among those that keep them, no worse in any objective. With one objective this is plain differential
//! evolution. A whole generation is evaluated at once, so that whoever evaluates may share it among threads:
//! all chance is drawn before. Objectives are minimised; the objectives may jump, no gradient is asked for.
//! Invariant: knows nothing of axes; the same seed and the same answers give the same bits on any number of threads.

use std::ops::ControlFlow;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Share of the trial that comes from the difference.
const CROSSOVER: f64 = 0.9;
/// The scale of differences is drawn anew for each trial from this range: with one fixed scale, few members can
/// only reach few points.
const SCALE: [f64; 2] = [0.4, 0.9];

/// How to search.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Members of the population, 4 or more.
    pub population: usize,
    /// No generation is begun that would pass so many evaluations.
    pub evaluations_max: usize,
    /// With one objective the search is over once all members lie within this share of the bounds, each kind
    /// of coordinate for itself.
    pub settled: f64,
    /// With one objective the search is also over when so many generations, one after another, made the best less
    /// by no more than the share `worth_more` together.
    pub patience: usize,
    /// See there.
    pub worth_more: f64,
    /// Of everything random.
    pub seed: u64,
}

/// What a point is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Worth {
    /// To be minimised; what is not a number is worse than any.
    pub objectives: Vec<f64>,
    /// How far the constraints are broken, all together; zero or less where all are kept.
    pub violation: f64,
}

/// A point and what it is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Coordinates, within the bounds.
    pub place: Vec<f64>,
    /// Its worth.
    pub worth: Worth,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Evolved {
    /// The members that none is better than: with one objective the best alone. Sorted by the first objective.
    pub front: Vec<Member>,
    /// Points evaluated.
    pub evaluations: usize,
    /// Whether it went on to its end.
    pub is_complete: bool,
}

impl Worth {
    /// Worth of what cannot be had at all.
    fn rank(value: f64) -> f64 {
        if value.is_nan() { f64::INFINITY } else { value }
    }

    /// No worse in anything, by Deb's rules.
    fn is_as_good_as(&self, other: &Self) -> bool {
        let [own, theirs] = [self, other].map(|worth| Self::rank(worth.violation).max(0.0));
        if own > 0.0 || theirs > 0.0 {
            return own <= theirs;
        }
        let mut pairs = self.objectives.iter().zip(&other.objectives);
        pairs.all(|(own, theirs)| Self::rank(*own) <= Self::rank(*theirs))
    }

    fn is_better_than(&self, other: &Self) -> bool {
        self.is_as_good_as(other) && !other.is_as_good_as(self)
    }
}

/// Search within bounds. `known` places are among the first; `evaluate` says what places are worth, one answer
/// for each; `watch` sees the population after each generation and may end the search.
///
/// # Panics
/// When a bound is empty, the population is too small, or an answer is missing.
pub fn evolve(
    bounds: &[[f64; 2]],
    known: &[Vec<f64>],
    settings: &Settings,
    mut evaluate: impl FnMut(&[Vec<f64>]) -> Vec<Worth>,
    mut watch: impl FnMut(&[Member], usize) -> ControlFlow<()>,
) -> Evolved {
    assert!(settings.population >= 4, "a difference and a base need 4 members");
    assert!(bounds.iter().all(|[low, high]| low <= high), "a bound is empty: {bounds:?}");
    let mut random = Pcg64Mcg::seed_from_u64(settings.seed);
    let mut judged = |places: Vec<Vec<f64>>| -> Vec<Member> {
        let worths = evaluate(&places);
        assert_eq!(worths.len(), places.len(), "one answer for each place");
        places.into_iter().zip(worths).map(|(place, worth)| Member { place, worth }).collect()
    };
    let mut first: Vec<Vec<f64>> = known.iter().take(settings.population).cloned().collect();
    while first.len() < settings.population {
        first.push(bounds.iter().map(|[low, high]| low + (high - low) * random.random::<f64>()).collect());
    }
    let mut members = judged(first);
    let mut evaluations = members.len();
    let mut bests = Vec::new();
    let is_complete = loop {
        if watch(&members, evaluations).is_break() {
            break false;
        }
        let has_settled = members[0].worth.objectives.len() == 1
            && widest(&members, bounds) <= settings.settled
            && members.iter().all(|member| member.worth.violation <= 0.0);
        bests.push(best(&members));
        let stands = members[0].worth.objectives.len() == 1 && is_still(&bests, settings);
        if has_settled || stands || evaluations + members.len() > settings.evaluations_max {
            break true;
        }
        let trials = (0..members.len()).map(|own| trial(&members, own, bounds, &mut random)).collect();
        let trials = judged(trials);
        evaluations += trials.len();
        let mut both = Vec::new();
        for (member, trial) in members.iter_mut().zip(trials) {
            if trial.worth.is_as_good_as(&member.worth) {
                *member = trial;
            } else if !member.worth.is_better_than(&trial.worth) {
                both.push(trial);
            }
        }
        members.extend(both);
        members = cut(members, settings.population);
    };
    let mut front = fronts(&members).swap_remove(0);
    if members[0].worth.objectives.len() == 1 {
        front.truncate(1);
    }
    let mut front: Vec<Member> = front.into_iter().map(|index| members[index].clone()).collect();
    front.sort_by(|a, b| a.worth.objectives[0].total_cmp(&b.worth.objectives[0]));
    Evolved { front, evaluations, is_complete }
}

/// The least objective of what keeps all constraints; infinite where nothing does.
fn best(members: &[Member]) -> f64 {
    let kept = members.iter().filter(|member| member.worth.violation <= 0.0);
    kept.map(|member| Worth::rank(member.worth.objectives[0])).fold(f64::INFINITY, f64::min)
}

/// Whether the last generations made the best no better, as far as that is worth anything.
fn is_still(bests: &[f64], settings: &Settings) -> bool {
    let Some(before) = bests.len().checked_sub(settings.patience + 1).map(|index| bests[index]) else {
        return false;
    };
    let now = bests[bests.len() - 1];
    before.is_finite() && before - now <= settings.worth_more * before.abs()
}

/// A challenger of a member.
fn trial(members: &[Member], own: usize, bounds: &[[f64; 2]], random: &mut Pcg64Mcg) -> Vec<f64> {
    let mut chosen = [own; 4];
    for at in 1..chosen.len() {
        while chosen[..at].contains(&chosen[at]) {
            chosen[at] = random.random_range(0..members.len());
        }
    }
    for at in 2..chosen.len() {
        if members[chosen[at]].worth.is_better_than(&members[chosen[1]].worth) {
            chosen.swap(1, at);
        }
    }
    let [own, base, from, to] = chosen.map(|index| &members[index].place);
    let scale = SCALE[0] + (SCALE[1] - SCALE[0]) * random.random::<f64>();
    let certain = random.random_range(0..bounds.len());
    let coordinate = |(at, [low, high]): (usize, &[f64; 2])| {
        let is_crossed = random.random::<f64>() < CROSSOVER || at == certain;
        if is_crossed { (base[at] + scale * (to[at] - from[at])).clamp(*low, *high) } else { own[at] }
    };
    bounds.iter().enumerate().map(coordinate).collect()
}

/// How far the members lie apart, as a share of the bounds, in the coordinate where they do most.
fn widest(members: &[Member], bounds: &[[f64; 2]]) -> f64 {
    let width = |(at, [low, high]): (usize, &[f64; 2])| {
        let values = || members.iter().map(|member| member.place[at]);
        let span = values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min);
        if high > low { span / (high - low) } else { 0.0 }
    };
    bounds.iter().enumerate().map(width).fold(0.0, f64::max)
}

/// Numbers of the members, front by front: none in a front is better than another in it, and each is only less
/// good than some of the fronts before.
fn fronts(members: &[Member]) -> Vec<Vec<usize>> {
    let mut left: Vec<usize> = (0..members.len()).collect();
    let mut fronts = Vec::new();
    while !left.is_empty() {
        let is_beaten =
            |own: &usize| left.iter().any(|other| members[*other].worth.is_better_than(&members[*own].worth));
        let (beaten, front): (Vec<usize>, Vec<usize>) = left.iter().partition(|own| is_beaten(own));
        fronts.push(front);
        left = beaten;
    }
    fronts
}

/// As many members as there may be: the best fronts whole, and of the front that is too large the least crowded.
fn cut(members: Vec<Member>, most: usize) -> Vec<Member> {
    if members.len() <= most {
        return members;
    }
    let mut kept: Vec<usize> = Vec::new();
    for mut front in fronts(&members) {
        // One at a time: who goes makes room for its neighbours.
        while kept.len() + front.len() > most {
            let crowded = most_crowded(&members, &front);
            front.remove(crowded);
        }
        kept.extend(front);
        if kept.len() == most {
            break;
        }
    }
    kept.into_iter().map(|index| members[index].clone()).collect()
}

/// The place in a front of the member whose neighbours in all objectives are nearest, together.
fn most_crowded(members: &[Member], front: &[usize]) -> usize {
    let value = |at: usize, objective: usize| members[front[at]].worth.objectives[objective];
    let mut room = vec![0.0; front.len()];
    for objective in 0..members[front[0]].worth.objectives.len() {
        let mut order: Vec<usize> = (0..front.len()).collect();
        order.sort_by(|a, b| value(*a, objective).total_cmp(&value(*b, objective)));
        let [first, last] = [order[0], order[order.len() - 1]];
        let span = value(last, objective) - value(first, objective);
        // The ends of a front are its best in something.
        room[first] = f64::INFINITY;
        room[last] = f64::INFINITY;
        for three in order.windows(3) {
            if span > 0.0 {
                room[three[1]] += (value(three[2], objective) - value(three[0], objective)) / span;
            }
        }
    }
    (0..front.len()).min_by(|a, b| room[*a].total_cmp(&room[*b])).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: Settings = Settings {
        population: 20,
        evaluations_max: 4_000,
        settled: 1e-6,
        patience: 40,
        worth_more: 1e-9,
        seed: 1,
    };

    fn search(bounds: &[[f64; 2]], settings: &Settings, worth: impl Fn(&[f64]) -> Worth) -> Evolved {
        let all = |places: &[Vec<f64>]| places.iter().map(|place| worth(place)).collect();
        evolve(bounds, &[], settings, all, |_, _| ControlFlow::Continue(()))
    }

    fn single(objective: f64, violation: f64) -> Worth {
        Worth { objectives: vec![objective], violation }
    }

    #[test]
    fn a_valley_with_steps_is_walked_down_from_any_seed() {
        for seed in 0..20 {
            let steps = |v: f64| v + 0.02 * (v * 40.0).floor() / 40.0;
            let rosenbrock = |p: &[f64]| steps(100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2));
            let settings = Settings { seed, evaluations_max: 20_000, ..SETTINGS };
            let best = search(&[[-2.0, 2.0]; 2], &settings, |p| single(rosenbrock(p), 0.0));
            let [x, y] = [best.front[0].place[0], best.front[0].place[1]];
            assert!((x - 1.0).abs() < 1e-3 && (y - 1.0).abs() < 2e-3, "seed {seed}: {x}, {y}");
        }
    }

    #[test]
    fn the_corner_of_a_bound_and_a_constraint_is_met() {
        // Largest x^2 y with x <= 1 and x + 2 y <= 2: at the bound, and on the line.
        let worth = |p: &[f64]| single(-p[0] * p[0] * p[1], p[0] + 2.0 * p[1] - 2.0);
        let best = &search(&[[0.0, 1.0], [0.0, 5.0]], &SETTINGS, worth).front[0];
        assert_eq!(best.place[0], 1.0, "at the bound, not near it");
        assert!((best.place[1] - 0.5).abs() < 1e-5 && best.worth.violation <= 0.0, "{best:?}");
    }

    #[test]
    fn a_search_that_finds_nothing_better_any_more_ends() {
        // Flat steps: members lie apart on the lowest one, and none is better.
        let worth = |p: &[f64]| single((p[0].abs() * 4.0).floor(), 0.0);
        let ended = search(&[[-4.0, 4.0]], &Settings { patience: 10, ..SETTINGS }, worth);
        assert!(ended.is_complete && ended.front[0].worth.objectives[0] == 0.0, "{ended:?}");
        assert!((220..600).contains(&ended.evaluations), "{} evaluations", ended.evaluations);
    }

    #[test]
    fn what_cannot_be_kept_is_broken_least_and_not_a_number_loses() {
        let worth = |p: &[f64]| single(if p[0] > 0.0 { f64::NAN } else { p[0] }, 1.0 + p[0].powi(2));
        let best = &search(&[[-1.0, 1.0]], &SETTINGS, worth).front[0];
        assert!(best.place[0].abs() < 1e-3, "{best:?}");
        let worth = |p: &[f64]| single(if p[0] > 0.3 { f64::NAN } else { -p[0] }, 0.0);
        let best = &search(&[[-1.0, 1.0]], &SETTINGS, worth).front[0];
        assert!((best.place[0] - 0.3).abs() < 1e-3, "{best:?}");
    }

    #[test]
    fn two_objectives_give_the_whole_front_evenly() {
        // Schaffer: x^2 against (x - 2)^2, best for x in 0..2.
        let worth = |p: &[f64]| Worth { objectives: vec![p[0] * p[0], (p[0] - 2.0).powi(2)], violation: 0.0 };
        let front = search(&[[-10.0, 10.0]], &SETTINGS, worth).front;
        assert!(front.len() >= 18, "{} members", front.len());
        let places: Vec<f64> = front.iter().map(|member| member.place[0]).collect();
        assert!(places.iter().all(|x| (-0.01..=2.01).contains(x)), "{places:?}");
        let gap = places.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(places[0] < 0.1 && places[places.len() - 1] > 1.9 && gap < 0.35, "{places:?}");
    }

    #[test]
    fn a_seed_gives_the_same_bits_and_a_wish_ends_the_search() {
        let worth = |p: &[f64]| single((p[0] - 0.3).abs() + p[1].powi(2), 0.0);
        let bounds = [[-1.0, 1.0]; 2];
        let again = |seed| search(&bounds, &Settings { seed, settled: 1e-3, ..SETTINGS }, worth).front;
        assert_eq!(again(5), again(5));
        assert_ne!(again(5), again(6));
        let all = |places: &[Vec<f64>]| places.iter().map(|place| worth(place)).collect();
        let stop = |_: &[Member], evaluations| {
            if evaluations >= 60 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let known = vec![vec![0.3, 0.0]];
        let ended = evolve(&bounds, &known, &SETTINGS, all, stop);
        assert_eq!((ended.evaluations, ended.is_complete), (60, false));
        assert_eq!(ended.front[0].place, known[0], "the best so far is kept");
    }
}
