//! The runs that show every effect of the catalogue on a machine: which motions, how far, how fast, each as a log of
//! its own.
//!
//! | runs | motions | shows |
//! |---|---|---|
//! | `circles-*`, `heldout-circles` | both ways at three feeds, two turns each; of one axis alone to and fro | friction at reversals, what differs by feed; and how well a pass repeats |
//! | `sweep-AXIS` | constant velocities both ways, slow to fast | what hangs by velocity, direction, place and angle |
//! | `small-reversals-AXIS` | to and fro over micrometres to a millimetre | play, pre-sliding, wind-up |
//! | `accelerations-AXIS`, `heldout-...` | steep lines to and fro | what hangs by force and current, delays, lags, modes |
//! | `repetition` | circles for as long as is asked | what changes as the machine gets warm |
//!
//! Runs whose names begin with `heldout` judge what was fitted to the others. Lines and circles are drawn up as
//! those of identification are (`identify/plan/draft.rs`).
//! Invariant: what no run shows is said, with what would.

use std::collections::BTreeMap;

use crate::base::axis::AxisId;
use crate::base::motion::Direction;
use crate::base::time::Span;
use crate::config::Machine;
use crate::config::machine::AXIS_NAMES;
use crate::config::plan::PlanError;
use crate::offline::identify::plan::draft::Draft;
use crate::offline::identify::plan::reversals::Round;
use crate::offline::identify::plan::{Plan, Request};
use crate::plant::effects::{CATALOGUE, Entry, Experiment};
use crate::rt::cycle::procedure::Programme;

/// Names and feeds of the circles, mm/min: that of the middle judges what the others were fitted to.
const CIRCLES: [(&str, f64); 3] =
    [("circles-slow", 1_000.0), ("heldout-circles", 2_000.0), ("circles-fast", 4_000.0)];
const RADIUS_MM: f64 = 10.0;
/// The second shows how well the first repeats.
const TURNS: u32 = 2;
/// Turns on end, each way, of a circle that is repeated for long.
const TURNS_REPEATED: u32 = 20;
/// Speeds of the sweep, mm/s: evenly on a logarithmic scale, from the fall of friction to the rapid traverse.
const LADDER_MM_PER_S: [f64; 7] = [0.5, 1.5, 5.0, 15.0, 50.0, 120.0, 300.0];
/// Ways of small reversals, um, each so often, each line in this time.
const WAYS_UM: [f64; 8] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1_000.0];
const TIMES: usize = 2;
const SWING: Span = Span::ms(400);
/// Shares of the limits of current and acceleration that steep lines take, and how many of each; the middle judges.
const STEEP: [f64; 2] = [0.3, 0.7];
const STEEP_HELD: f64 = 0.5;
const STEEP_RUNS: usize = 4;

/// A run that is to be recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Of its log.
    pub name: String,
    /// What moves.
    pub plan: Plan,
    /// What it shows.
    pub shows: Experiment,
    /// Of which axis; `None`: of all that move.
    pub axis: Option<AxisId>,
}

/// All runs of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Recordings {
    /// In order; each begins and ends with every axis where it stood.
    pub runs: Vec<Recording>,
    /// What was left out, and why.
    pub left_out: Vec<String>,
}

impl Recordings {
    /// The runs that a machine allows; circles for so many minutes on end where that is asked.
    ///
    /// # Errors
    /// When there is no such gain set.
    pub fn of(machine: &Machine, request: &Request, repetition_min: Option<f64>) -> Result<Self, PlanError> {
        let gain_set = machine.planned_gain_set(&request.gains)?;
        let axes = request.axes_of(machine);
        let mut all = Self { runs: Vec::new(), left_out: Vec::new() };
        let mut add =
            |name: &str, shows: Experiment, axis: Option<AxisId>, steps: &dyn Fn(&mut Draft<'_>)| {
                let mut draft = Draft::new(machine, gain_set);
                steps(&mut draft);
                let has_motion = !draft.plan.steps.is_empty();
                machine.axes.axes().for_each(|axis| draft.go(axis, Default::default()));
                let why = std::mem::take(&mut draft.plan.left_out);
                all.left_out.extend(why.into_iter().map(|why| format!("{name}: {why}")));
                if has_motion {
                    all.runs.push(Recording { name: name.to_owned(), plan: draft.plan, shows, axis });
                }
            };
        let has_circles = [AxisId::X, AxisId::Y].iter().all(|axis| axes.contains(axis));
        // One axis alone goes to and fro.
        let both_ways = |draft: &mut Draft<'_>, feed_mm_per_min: f64, turns: u32| {
            for direction in [Direction::Ccw, Direction::Cw] {
                let round =
                    Round { feed_mm_per_min, radius_mm_max: RADIUS_MM, direction, revolutions: turns };
                match (has_circles, direction) {
                    (true, _) => draft.round(&request.gains, &round),
                    (false, Direction::Ccw) => {
                        axes.iter().for_each(|axis| draft.swing(*axis, &round, 4 * turns))
                    }
                    (false, Direction::Cw) => {}
                }
            }
        };
        for (name, feed) in CIRCLES {
            add(name, Experiment::Circles, None, &|draft| both_ways(draft, feed, TURNS));
        }
        for axis in &axes {
            let letter = AXIS_NAMES[axis.index()];
            add(&format!("sweep-{letter}"), Experiment::Sweep, Some(*axis), &|draft| {
                draft.steady(*axis, &LADDER_MM_PER_S)
            });
            add(&format!("small-reversals-{letter}"), Experiment::SmallReversals, Some(*axis), &|draft| {
                draft.small_reversals(*axis, &WAYS_UM, SWING, TIMES);
            });
            add(&format!("accelerations-{letter}"), Experiment::Accelerations, Some(*axis), &|draft| {
                STEEP.iter().for_each(|share| draft.accelerate(*axis, *share, STEEP_RUNS));
            });
            add(
                &format!("heldout-accelerations-{letter}"),
                Experiment::Accelerations,
                Some(*axis),
                &|draft| {
                    draft.accelerate(*axis, STEEP_HELD, STEEP_RUNS);
                },
            );
        }
        if let Some(minutes) = repetition_min {
            let (_, feed) = CIRCLES[CIRCLES.len() - 1];
            let turn_s = std::f64::consts::TAU * RADIUS_MM / (feed / 60.0);
            let times = (minutes * 60.0 / (2.0 * f64::from(TURNS_REPEATED) * turn_s)).ceil() as u32;
            add("repetition", Experiment::Repetition, None, &|draft| {
                (0..times).for_each(|_| both_ways(draft, feed, TURNS_REPEATED));
            });
        }
        Ok(all)
    }

    /// The circles, whose laps tell the noise, and what shows an effect of an axis.
    #[must_use]
    pub fn only(mut self, entry: &Entry, axis: AxisId) -> Self {
        self.runs.retain(|run| {
            run.shows == Experiment::Circles || run.shows == shown_by(entry) && run.axis == Some(axis)
        });
        self
    }

    /// How long all of them take, s.
    pub fn duration_s(&self) -> f64 {
        self.runs.iter().map(|run| run.plan.duration_s()).sum()
    }

    /// Whether one of the runs shows an effect of the catalogue.
    pub fn shows(&self, entry: &Entry) -> bool {
        self.runs.iter().any(|run| run.shows == shown_by(entry))
    }

    /// Effects that none of the runs shows.
    pub fn unseen(&self) -> Vec<&'static Entry> {
        CATALOGUE.iter().filter(|entry| !self.shows(entry)).collect()
    }

    /// Their names by what would show them.
    pub fn unseen_by_experiment(&self) -> BTreeMap<String, Vec<&'static str>> {
        let mut all = BTreeMap::<String, Vec<&'static str>>::new();
        for entry in self.unseen() {
            all.entry(entry.experiment.to_string()).or_default().push(entry.name);
        }
        all
    }

    /// All that the axes do, one run after the other.
    pub fn programme(&self) -> Programme {
        let gain_set = self.runs.first().map_or(0, |run| run.plan.gain_set);
        let steps = self.runs.iter().flat_map(|run| run.plan.steps.iter().map(|planned| planned.step));
        Programme { gain_set, steps: steps.collect() }
    }
}

/// What shows an effect: what asks for an excitation shows in steep lines as well, and those have a command.
const fn shown_by(entry: &Entry) -> Experiment {
    match entry.experiment {
        Experiment::Excitation => Experiment::Accelerations,
        experiment => experiment,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::rt::cycle::procedure::Step;

    fn recordings(machine: &Machine, axes: &[AxisId], repetition_min: Option<f64>) -> Recordings {
        let request = Request { gains: "standard".to_owned(), axes: axes.to_vec() };
        Recordings::of(machine, &request, repetition_min).unwrap()
    }

    #[test]
    fn every_effect_is_shown_on_every_embedded_machine_and_no_limit_is_passed() {
        for (name, _) in config::EMBEDDED {
            let machine = config::load(name).unwrap();
            for axes in [&[][..], &[AxisId::Y]] {
                let all = recordings(&machine, axes, Some(60.0));
                assert_eq!(all.left_out, Vec::<String>::new(), "{name}");
                assert!(all.unseen().is_empty(), "{name}: {:?}", all.unseen_by_experiment());
                for (id, axis) in machine.axes.iter() {
                    let (low, high) = all.programme().reach(id);
                    let limits = &axis.control.limits;
                    assert!(low >= limits.travel_min + limits.travel_margin, "{name}, axis {id}: {low}");
                    assert!(high <= limits.travel_max - limits.travel_margin, "{name}, axis {id}: {high}");
                    assert_eq!(
                        low == high,
                        !axes.is_empty() && !axes.contains(&id),
                        "{name}, axis {id} moves"
                    );
                }
                let limits = &machine.axes[AxisId::Y].control.limits;
                assert!(all.programme().velocity_max() <= limits.velocity, "{name}");
                assert!(all.programme().acceleration_max() <= limits.acceleration, "{name}");
            }
        }
    }

    #[test]
    fn each_run_ends_where_it_began_and_some_judge_the_others() {
        let machine = config::load("paper").unwrap();
        let all = recordings(&machine, &[], None);
        let unseen: Vec<_> = all.unseen().iter().map(|entry| entry.name).collect();
        assert_eq!(unseen, ["friction-warm-up", "thermal-growth"]);
        for run in &all.runs {
            let mut place = [Some(Default::default()); 2];
            for step in run.plan.steps.iter().map(|planned| planned.step) {
                match step {
                    Step::Line(way) => {
                        place = [0, 1].map(|axis| way.target[axis].or(place[axis]));
                    }
                    // Beside the start, so that a way back must follow.
                    Step::Circle(_) => place = [None; 2],
                    _ => {}
                }
            }
            assert_eq!(place, [Some(Default::default()); 2], "{}", run.name);
        }
        let judging = all.runs.iter().filter(|run| run.name.starts_with("heldout")).count();
        assert_eq!(judging, 3, "circles, and accelerations of either axis");
        // About as long as a person waits.
        assert!((100.0..400.0).contains(&all.duration_s()), "{} s", all.duration_s());
    }
}
