//! The steps, one after the other; an error ends them, and nothing but the last changes a machine file.

use anyhow::{Context, bail, ensure};

use super::super::circle::live::CircleJob;
use super::super::identify::experiments;
use super::super::live::{self, Job, Recorded, beside, outcome_of, with_losses};
use super::super::tune::request::least_protrusion;
use super::super::tune::search;
use super::super::{Outcome, view};
use super::consent::ask;
use super::printed::{CircleTold, Told, TunedTold};
use super::setup::{REDUCED, Setup, circle_request};
use crate::config::Machine;
use crate::config::edit::MachineFile;
use crate::log::WriteOutcome;
use crate::log::header::rfc3339;
use crate::offline::autotune::{CircleFigures, no_better, worse};
use crate::offline::check::MachineReport;
use crate::offline::circle::motions::analyse_test;
use crate::offline::identify::axis::{self, IdentifiedAxis};
use crate::offline::identify::logged::Settings;
use crate::offline::identify::logs::Logs;
use crate::offline::identify::write_back::{self, Origin};
use crate::offline::tune::gain_set;
use crate::offline::tune::whole::{DIRECTIONS, circle as circle_of, circular_test};
use crate::offline::tune::window::Path;
use crate::rt::cycle::procedure::Ending;
use crate::run::{VERSION, wall_now_ns};

/// Without these of each axis there is nothing to tune on.
const NEEDED: [&str; 4] = ["total_inertia", "sliding", "breakaway", "stiffness"];

/// Takes all steps; `told` has what came of them, also of those before one that failed.
pub(super) fn run(setup: &Setup<'_>, mut file: MachineFile, told: &mut Told) -> anyhow::Result<()> {
    let Setup { arguments, machine, path, .. } = setup;
    let from = &arguments.search.from;
    told.begin("check", "does the machine answer, and is it what its file says; nothing moves");
    check(setup)?;

    told.begin("circle-before", &format!("a circle at full feed with the gains {from}"));
    told.before = Some(circle(setup, machine, from, *path, told)?);

    told.begin("identify", &format!("experiments with the gains {from}, and what they tell"));
    let believed = identify(setup, &mut file, told)?;

    told.begin("tune", "gains for the machine that was identified; nothing moves");
    let candidate = tune(setup, &believed, &mut file, told)?;

    let name = &arguments.name;
    told.begin("circle-reduced", "the first circle with the new gains, at reduced feed");
    let reduced = circle(setup, &candidate, name, path.at(REDUCED), told)?;
    let objections = told.objections(&reduced.figures, &candidate);
    told.reduced = Some(reduced.figures);
    refuse(&objections)?;

    told.begin("circle-after", "the circle at full feed with the new gains");
    told.after = Some(circle(setup, &candidate, name, *path, told)?);

    told.begin("compare", "the circle after against the circle before; nothing moves");
    let (Some(before), Some(after)) = (&told.before, &told.after) else { bail!("a circle is missing") };
    let mut objections = told.objections(&after.figures, &candidate);
    objections.extend(no_better(&before.figures, &after.figures));
    refuse(&objections)?;

    told.begin("write", &format!("gain set {name} and what was identified, into {}", file.path().display()));
    write(setup, &candidate, file, told)
}

impl Told {
    /// What is worse on a circle than on the one before.
    fn objections(&self, after: &CircleFigures, machine: &Machine) -> Vec<String> {
        let limits = machine.axes.map(|_, axis| axis.control.limits.current);
        self.before.as_ref().map(|before| worse(&before.figures, after, &limits)).unwrap_or_default()
    }
}

fn refuse(objections: &[String]) -> anyhow::Result<()> {
    ensure!(objections.is_empty(), "the circle is worse: {}", objections.join("; "));
    Ok(())
}

fn check(setup: &Setup<'_>) -> anyhow::Result<()> {
    for warning in MachineReport::of(&setup.machine).warnings {
        eprintln!("  warning: {}: {}", warning.key, warning.message);
    }
    live::greet(&setup.machine, &setup.plant, &setup.place, setup.arguments.stage.allow_jitter)
}

/// A circular test both ways round, from where the axes stand and back.
fn circle(
    setup: &Setup<'_>,
    machine: &Machine,
    gains: &str,
    path: Path,
    told: &mut Told,
) -> anyhow::Result<CircleTold> {
    let request = circle_request(gains, &path);
    let log = setup.log(told.step());
    let job = CircleJob {
        machine,
        plant: &setup.plant,
        request: &request,
        test: machine.circle_test(&request)?,
        returns: true,
        place: &setup.place,
        allow_jitter: setup.arguments.stage.allow_jitter,
        stop_wish: setup.stop.clone(),
        log: &log,
        title: "circular test",
    };
    let (programme, duration_s) = (job.programme(), job.duration_s());
    eprint!("{}{}", view::reach(machine, &programme), view::pace_of(&programme, duration_s));
    go(setup)?;
    let recording = job.record()?;
    ended(&recording.ending, &recording.log, recording.lost_records, told)?;
    let twin = recording.twin.as_ref().context("the same circle without friction did not come to its end")?;
    let test = analyse_test(&circle_of(&path), &DIRECTIONS, &recording.trace, Some(twin))?;
    let figures = CircleFigures::of(&test, &recording.trace);
    eprintln!("  {}", view::circle_line(&figures));
    Ok(CircleTold { figures, test })
}

/// What the machine is, as experiments tell it: put into the text of the file, and given back as a machine.
fn identify(setup: &Setup<'_>, file: &mut MachineFile, told: &mut Told) -> anyhow::Result<Machine> {
    let Setup { machine, plant, experiments: request, plan, place, .. } = setup;
    experiments::say(machine, plan);
    go(setup)?;
    let log = setup.log(told.step());
    let job = Job {
        machine,
        plant,
        programme: plan.programme(),
        place,
        allow_jitter: setup.arguments.stage.allow_jitter,
        stop_wish: setup.stop.clone(),
        log: &log,
        title: "experiments",
        duration_s: plan.duration_s(),
    };
    let header = |origin: &_| experiments::header(machine, plant, request, plan, origin, place);
    let (Recorded { ending, log: written, lost_records, .. }, ()) = job.run(header, |_| (None, ()))?;
    ended(&ending, &written, lost_records, told)?;

    let logs = Logs::open(&[log])?;
    let tolerance = setup.arguments.forces.torque_constant_tolerance_percent;
    let axes = logs.identify_all(Settings { torque_constant_tolerance_percent: tolerance })?;
    told.identified = axis::findings(&axes);
    let taken = write_back::put(file, machine, &axes, &Origin::of(&logs))?;
    for kept in &taken.kept {
        eprintln!("  not told, the value of the file stays: {kept}");
    }
    told.kept_values = taken.kept;
    let missing = axes.iter().flat_map(missing).collect::<Vec<_>>();
    ensure!(missing.is_empty(), "not known, so there is nothing to tune on: {}", missing.join("; "));
    Ok(file.machine()?)
}

/// What is needed of an axis and was not told.
fn missing(axis: &IdentifiedAxis) -> Vec<String> {
    let is_told = |name: &&str| axis.findings.get(*name).is_some_and(|found| found.estimate().is_some());
    NEEDED.into_iter().filter(|name| !is_told(name)).map(|name| format!("{}.{name}", axis.name)).collect()
}

/// Gains for the machine that was identified, tried on its model: the file's text with them, as a machine.
fn tune(
    setup: &Setup<'_>,
    believed: &Machine,
    file: &mut MachineFile,
    told: &mut Told,
) -> anyhow::Result<Machine> {
    let (request, _) = least_protrusion(&setup.arguments.search, believed)?;
    let tuned = search(believed, &request, &setup.stop);
    ensure!(tuned.is_complete, "interrupted");
    ensure!(
        tuned.broken.is_empty(),
        "no gains within the bounds keep all constraints: {}; other margins or bounds are options",
        tuned.broken.join("; ")
    );
    let choice = tuned.best.choice;
    let gains = believed.axes.map(|_, axis| choice.gains(axis));
    let predicted = circular_test(believed, &gains, &request.path, request.seed, &setup.stop)
        .context("the new gains on the model of the machine")?;
    let predicted_um = predicted.motor.protrusion_um.max;
    gain_set::put(file, believed, &setup.arguments.name, &choice)?;
    eprintln!(
        "  V_p {:.3}, V_i {:.4}, K_p {:.3} 1/s; on the model {predicted_um:.2} um",
        choice.v_p, choice.v_i, choice.kp_per_s
    );
    told.tuned = Some(TunedTold { tuned, predicted_um });
    Ok(file.machine()?)
}

fn write(
    setup: &Setup<'_>,
    candidate: &Machine,
    mut file: MachineFile,
    told: &mut Told,
) -> anyhow::Result<()> {
    go_on("write it?", setup)?;
    let note = told.note(&rfc3339(wall_now_ns()), VERSION);
    gain_set::note(&mut file, candidate, &setup.arguments.name, &note)?;
    let path = file.path().to_owned();
    let beside = beside(&path, &setup.stamp);
    let is_new = !path.exists();
    file.keep_old(&beside)?;
    file.replace()?;
    told.old_file = (!is_new).then_some(beside);
    told.written = Some(path);
    Ok(())
}

fn go(setup: &Setup<'_>) -> anyhow::Result<()> {
    if live::moves_a_machine(&setup.place) {
        return go_on("  is the travel free, and somebody at the emergency stop? Move the axes?", setup);
    }
    go_on("  move the simulated axes?", setup)
}

fn go_on(question: &str, setup: &Setup<'_>) -> anyhow::Result<()> {
    ask(question, setup.arguments.yes, &setup.stop)
}

/// How a run ended: an error unless it came to its end; records that it lost are kept in mind.
fn ended(ending: &Ending, log: &WriteOutcome, lost_records: u64, told: &mut Told) -> anyhow::Result<()> {
    told.logs.push(log.path.clone());
    let outcome = with_losses(outcome_of(ending), log, lost_records);
    told.is_incomplete |= outcome == Outcome::Incomplete;
    match ending {
        Ending::Complete => Ok(()),
        Ending::Interrupted => bail!("interrupted; the axes came to rest along their path"),
        Ending::Refused => bail!("the cycle did not begin a motion that it was ordered"),
        Ending::Faulted(axis, fault) => bail!("axis {axis}: {fault}; see {}", fault.page()),
    }
}
