//! An axis as all of its logs tell it: by its stretches ([`LoggedAxis`]) and by what was excited ([`AxisResponse`]).
//!
//! For a reader each parameter stands with its narrowest interval. For a machine file some hold together only as one
//! fit told them, because what one of them has too much another has too little: the masses of motor and table, and
//! all that delays the loop (current loop, dead time, age of the encoders). Those are taken from the frequency response
//! as a group, or not from it at all.
//! `command_delay` is told by the frequency response: from the cycle of a command until the current loop gets it.
//! `dead_time` is told by the logs: the same without what the board waits by its sheet, a period or nothing.
//! Invariant: a parameter of the machine file that nothing told stays unknown here.

use std::collections::BTreeMap;

use super::frequency::AxisResponse;
use super::logged::{LoggedAxis, Settings};
use super::{AxisFindings, Estimate, Finding, Findings, joined};
use crate::base::time::Span;
use crate::config::Machine;
use crate::config::machine::Axis;

/// Told together by the fit of motor and table against each other.
const MASSES: [&str; 2] = ["mass", "motor_inertia"];
/// Told together by the fits of the current loop and of what comes after it.
const DELAYS: [&str; 3] = ["current_loop", "command_delay", "feedback_latency"];

/// An axis with all that was found of it.
#[derive(Clone, Debug)]
pub struct IdentifiedAxis {
    /// Its name.
    pub name: String,
    /// What its stretches tell.
    pub logged: LoggedAxis,
    /// What was excited tells, if anything was.
    pub response: Option<AxisResponse>,
    /// Of each parameter the surest.
    pub findings: AxisFindings,
    of_response: AxisFindings,
}

impl IdentifiedAxis {
    /// Puts together what both ways tell.
    pub fn new(name: String, logged: LoggedAxis, response: Option<AxisResponse>, settings: Settings) -> Self {
        let tolerance = settings.torque_constant_tolerance_percent;
        let of_response =
            response.as_ref().map(|response| response.findings_within(tolerance)).unwrap_or_default();
        let findings = joined(&logged.findings, Some(&of_response));
        Self { name, logged, response, findings, of_response }
    }

    /// Each axis of logs with its response.
    pub fn all(
        logged: Vec<(String, LoggedAxis)>,
        mut responses: BTreeMap<String, AxisResponse>,
        settings: Settings,
    ) -> Vec<Self> {
        let one = |(name, axis): (String, LoggedAxis)| {
            let response = responses.remove(&name);
            Self::new(name, axis, response, settings)
        };
        logged.into_iter().map(one).collect()
    }

    /// What a machine file takes, by the names of the findings: what holds together comes from one fit. `axis` is
    /// that of the file, with its `period`: it has what was not told.
    pub fn model(&self, axis: &Axis, period: Span) -> AxisFindings {
        let mut model = self.findings.clone();
        let tells = |names: &[&str]| {
            names.iter().all(|name| self.of_response.get(*name).is_some_and(|told| told.estimate().is_some()))
        };
        if tells(&MASSES) {
            self.take(&MASSES, &mut model);
        } else if let Some(motor) = self.motor_inertia(axis) {
            model.insert("motor_inertia".to_owned(), motor.into());
        }
        let has_delays = tells(&DELAYS);
        if has_delays {
            self.take(&DELAYS, &mut model);
        }
        if has_delays || model.get("dead_time").is_none_or(|told| told.estimate().is_none()) {
            let delay = self.of_response.get("command_delay").and_then(Finding::estimate);
            if let Some(delay) = delay {
                let wait_us = axis.sheet.command_delay(period).as_us();
                let less = |us: f64| us - wait_us;
                let source = format!("{}, less {wait_us} us that the board waits", delay.source);
                let dead =
                    Estimate { value: less(delay.value), ci95: delay.ci95.map(less), unit: "us", source };
                model.insert("dead_time".to_owned(), dead.into());
            }
        }
        model
    }

    fn take(&self, names: &[&str], model: &mut AxisFindings) {
        for name in names {
            if let Some(told) = self.of_response.get(*name) {
                model.insert((*name).to_owned(), told.clone());
            }
        }
    }

    /// What the mass in the file leaves of all that turns. A mass that is more than all that moves is not put right
    /// by a motor that weighs nothing.
    fn motor_inertia(&self, axis: &Axis) -> Option<Estimate> {
        let total = self.findings.get("total_inertia")?.estimate()?;
        let mechanics = &axis.plant.mechanics;
        let table = mechanics.total_inertia_kg_m2() - mechanics.inertia_kg_m2;
        let less = |value: f64| value - table;
        let source = format!("{}, less the mass of this file", total.source);
        let motor =
            Estimate { value: less(total.value), ci95: total.ci95.map(less), unit: total.unit, source };
        (motor.value > 0.0).then_some(motor)
    }
}

/// A machine with the viscous friction that its steady runs told: the frequency response sees it too.
pub fn sliding(machine: &Machine, logged: &[(String, LoggedAxis)]) -> Machine {
    let mut machine = machine.clone();
    for ((_, axis), (_, found)) in machine.axes.iter_mut().zip(logged) {
        let viscous_n_s_per_m = found.model.friction.viscous_n_s_per_m;
        axis.plant.friction.viscous_n_s_per_m = viscous_n_s_per_m;
        axis.control.axis.friction.viscous_n_s_per_m = viscous_n_s_per_m;
    }
    machine
}

/// The parameters of axes, by their names.
pub fn findings(axes: &[IdentifiedAxis]) -> Findings {
    axes.iter().map(|axis| (axis.name.clone(), axis.findings.clone())).collect()
}
