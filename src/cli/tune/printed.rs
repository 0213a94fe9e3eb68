//! What is printed of a tuning: for people and for programs.

use serde::Serialize;

use super::super::view;
use crate::config::Machine;
use crate::offline::circle::CircularTest;
use crate::offline::tune::{Goal, Judged, Objective, Request, Tuned, paper};
use crate::rt::control::velocity_pi::Memory;

/// A tuning, for programs.
#[derive(Debug, Serialize)]
pub(super) struct Printed<'a> {
    machine: &'a str,
    objective: String,
    objective_value: f64,
    v_p: f64,
    v_i: f64,
    kp_per_s: f64,
    velocity_feed_forward: f64,
    friction_feed_forward: f64,
    inertia_feed_forward: f64,
    kvp_nm_s_per_rad: f64,
    /// `None` where the integral part is a lag.
    kvi_nm_per_rad: Option<f64>,
    /// On the whole circle, at the motor encoder.
    protrusion_um: f64,
    protrusion_before_um: f64,
    table_protrusion_um: Option<f64>,
    /// At a single reversal, the worst of the plants.
    worst_um: Option<f64>,
    phase_margin_deg: f64,
    gain_margin_db: Option<f64>,
    ms: f64,
    current_noise_a_rms: f64,
    active_constraints: &'a [String],
    broken_constraints: &'a [String],
    undetermined: &'static [&'static str],
    evaluations: usize,
    plants: usize,
    seconds: f64,
    is_complete: bool,
    before: &'a Judged,
    after: &'a Judged,
    front: &'a [Judged],
    #[serde(skip)]
    circles: &'a [CircularTest; 2],
    #[serde(skip)]
    labels: Vec<&'static str>,
}

impl<'a> Printed<'a> {
    pub(super) fn of(
        machine: &'a Machine,
        request: &'a Request,
        before: &'a Judged,
        tuned: &'a Tuned,
        circles: &'a [CircularTest; 2],
        seconds: f64,
    ) -> Self {
        let axis = &machine.axes.as_slice()[0];
        let (choice, figures) = (&tuned.best.choice, &tuned.best.figures);
        let gains = choice.gains(axis).velocity;
        let (labels, undetermined): (Vec<&str>, &[&str]) = match &request.goal {
            Goal::Paper(_) => (vec!["1 / (a V_p (1 + b V_i)), rad/(N m s)"], &paper::UNDETERMINED),
            Goal::Machine { objectives, .. } => {
                (objectives.iter().map(|o: &Objective| o.label()).collect(), &[])
            }
        };
        let kvi_nm_per_rad = match gains.memory {
            Memory::Integrator { gain_nm_per_rad } => Some(gain_nm_per_rad),
            Memory::Lag { .. } => None,
        };
        Self {
            machine: &machine.name,
            objective: labels.join("; "),
            objective_value: tuned.best.objectives[0],
            v_p: choice.v_p,
            v_i: choice.v_i,
            kp_per_s: choice.kp_per_s,
            velocity_feed_forward: choice.velocity_feed_forward,
            friction_feed_forward: choice.friction_feed_forward,
            inertia_feed_forward: choice.inertia_feed_forward,
            kvp_nm_s_per_rad: gains.proportional_nm_s_per_rad,
            kvi_nm_per_rad,
            protrusion_um: circles[1].motor.protrusion_um.max,
            protrusion_before_um: circles[0].motor.protrusion_um.max,
            table_protrusion_um: circles[1].table.as_ref().map(|table| table.protrusion_um.max),
            worst_um: figures.worst_um,
            phase_margin_deg: figures.phase_margin_deg,
            gain_margin_db: Some(figures.gain_margin_db).filter(|db| db.is_finite()),
            ms: figures.ms,
            current_noise_a_rms: figures.current_noise_a_rms,
            active_constraints: &tuned.active,
            broken_constraints: &tuned.broken,
            undetermined,
            evaluations: tuned.evaluations,
            plants: tuned.cases,
            seconds,
            is_complete: tuned.is_complete,
            before,
            after: &tuned.best,
            front: if labels.len() > 1 { &tuned.front } else { &[] },
            circles,
            labels,
        }
    }

    /// Where the numbers of a gain set come from.
    pub(super) fn source(&self, seed: u64, is_cut_short: bool) -> String {
        let cut = if is_cut_short { ", interrupted" } else { "" };
        let held = if self.active_constraints.is_empty() {
            "nothing".to_owned()
        } else {
            self.active_constraints.join("; ")
        };
        format!(
            "quadrant tune, least {}, seed {seed}, {} evaluations{cut}\n{:.2} um on the simulated circle, before \
             {:.2} um; phase margin {:.1} deg, Ms {:.2}\nheld by {held}",
            self.objective,
            self.evaluations,
            self.protrusion_um,
            self.protrusion_before_um,
            self.phase_margin_deg,
            self.ms
        )
    }

    /// What holds the gains where they are, and what is open.
    pub(super) fn sentences(&self) -> Vec<String> {
        let active = self.active_constraints.iter().map(|words| format!("active: {words}"));
        let broken = self.broken_constraints.iter().map(|words| format!("broken: {words}"));
        let open = self.undetermined.iter().map(|words| format!("the paper leaves open: {words}"));
        broken.chain(active).chain(open).collect()
    }

    /// For people.
    pub(super) fn text(&self) -> String {
        let mut text = view::before_and_after(&self.rows());
        text += "\n\n";
        for sentence in self.sentences() {
            text += &format!("{sentence}\n");
        }
        if !self.front.is_empty() {
            text += &format!("\n{}\n\n", view::front(&self.labels, self.front));
        }
        text + &format!(
            "{} evaluations of {} plants in {:.1} s\n",
            self.evaluations, self.plants, self.seconds
        )
    }

    /// Name, before and after of each figure.
    pub(super) fn rows(&self) -> Vec<[String; 3]> {
        let both = [self.before, self.after];
        let row = |name: &str, decimals: usize, value: &dyn Fn(&Judged) -> f64| {
            let [before, after] = both.map(|judged| shown(Some(value(judged)), decimals));
            [name.to_owned(), before, after]
        };
        let test = |name: &str, value: &dyn Fn(&CircularTest) -> Option<f64>| {
            let [before, after] = [0, 1].map(|index| shown(value(&self.circles[index]), 2));
            [name.to_owned(), before, after]
        };
        let mut rows = vec![
            row("V_p", 3, &|j| j.choice.v_p),
            row("V_i", 4, &|j| j.choice.v_i),
            row("K_p, 1/s", 3, &|j| j.choice.kp_per_s),
            row("friction feed-forward", 3, &|j| j.choice.friction_feed_forward),
            row("inertia feed-forward", 3, &|j| j.choice.inertia_feed_forward),
        ];
        for (index, label) in self.labels.iter().enumerate() {
            rows.push(row(&format!("objective: {label}"), 4, &|j| j.objectives[index]));
        }
        rows.extend([
            row("phase margin, velocity loop, deg", 1, &|j| j.figures.phase_margin_deg),
            row("gain margin, velocity loop, dB", 1, &|j| j.figures.gain_margin_db),
            row("Ms, velocity loop", 2, &|j| j.figures.ms),
            row("current noise of the counts, mA rms", 2, &|j| 1e3 * j.figures.current_noise_a_rms),
            test("whole circle: protrusion, motor, um", &|test| Some(test.motor.protrusion_um.max)),
            test("whole circle: protrusion, table, um", &|test| {
                test.table.as_ref().map(|table| table.protrusion_um.max)
            }),
            test("whole circle: radius decrease, um", &|test| Some(test.motor.radius_decrease_um)),
        ]);
        rows
    }
}

/// A figure, or that there is none: gains that do not keep their margins are not run in the search.
fn shown(value: Option<f64>, decimals: usize) -> String {
    match value {
        Some(value) if value.is_finite() => format!("{value:.decimals$}"),
        Some(_) | None => "none".to_owned(),
    }
}
