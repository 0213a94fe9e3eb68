//! Runs the experiments of a machine and keeps their log: first says what will move, how far, how fast and how
//! long, and on a real machine asks.

use std::path::PathBuf;

use anyhow::bail;

use super::super::live::{Job, out_folder, outcome_of, stamp_now, stop_wish, with_losses};
use super::super::stage::{may_move, whereabouts};
use super::super::{Outcome, axes_of, view};
use super::{Arguments, logs};
use crate::config::Machine;
use crate::log::Header;
use crate::offline::identify::plan::{Plan, Request};
use crate::run::{self, Origin, Place};

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let [machine, plant] = arguments.stage.machines()?;
    let request = Request { gains: arguments.gains.clone(), axes: axes_of(&machine, &arguments.axes)? };
    let plan = Plan::of(&machine, &request)?;
    if plan.steps.is_empty() {
        bail!("machine {}: no experiment is possible: {}", machine.name, plan.left_out.join("; "));
    }
    let place = arguments.stage.place(arguments.seed);
    announce(&machine, &plan, &place);
    if !may_move(&place, arguments.yes)? {
        return Ok(Outcome::NotDone);
    }
    let log = log_file(arguments, &machine)?;
    let job = Job {
        machine: &machine,
        plant: &plant,
        programme: plan.programme(),
        place: &place,
        allow_jitter: arguments.stage.allow_jitter,
        stop_wish: stop_wish(&place)?,
        log: &log,
        title: "experiments",
        duration_s: plan.duration_s(),
    };
    let header = |origin: &Origin| header(&machine, &plant, &request, &plan, origin, &place);
    let (recorded, ()) = job.run(header, |_| (None, ()))?;
    let outcome = with_losses(outcome_of(&recorded.ending), &recorded.log, recorded.lost_records);
    if outcome == Outcome::NotDone {
        eprintln!("the log is kept: {}", log.display());
        return Ok(outcome);
    }
    eprintln!("{} cycles in {:.1} s, log: {}", recorded.cycles, recorded.wall_s, log.display());
    let analysed = logs::run(arguments, &[log])?;
    Ok(if outcome == Outcome::Done { analysed } else { outcome })
}

fn announce(machine: &Machine, plan: &Plan, place: &Place<'_>) {
    eprintln!("machine {}, {}", machine.name, whereabouts(place));
    say(machine, plan);
}

/// What the experiments do.
pub(in crate::cli) fn say(machine: &Machine, plan: &Plan) {
    let (programme, duration_s) = (plan.programme(), plan.duration_s());
    eprint!("{}{}", view::reach(machine, &programme), view::pace_of(&programme, duration_s));
    eprintln!("{}", view::experiments(&plan.summary()));
    plan.left_out.iter().for_each(|why| eprintln!("left out: {why}"));
    eprintln!("Ctrl-C brings the axes to rest along their path");
}

fn log_file(arguments: &Arguments, machine: &Machine) -> anyhow::Result<PathBuf> {
    if let Some(file) = &arguments.log_to {
        return Ok(file.clone());
    }
    let stamp = stamp_now();
    let folder = out_folder(None, &format!("{stamp}-identify-{}", machine.name))?;
    Ok(folder.join(format!("identify-{stamp}.mcap")))
}

/// What the log says of the experiments.
pub(in crate::cli) fn header(
    machine: &Machine,
    plant: &Machine,
    request: &Request,
    plan: &Plan,
    origin: &Origin,
    place: &Place<'_>,
) -> Header {
    let mut header = run::header(machine, place, origin, "quadrant");
    header.motions = plan.motions();
    header.extra.insert("gains".to_owned(), request.gains.clone());
    if place.interface.is_none() && plant.source != machine.source {
        header.extra.insert("plant".to_owned(), plant.source.clone());
    }
    header
}
