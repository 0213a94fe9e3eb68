//! Everything that can be refused before anything moves: machine, axes, circles, experiments, the file that is to be
//! written and the folder of the logs.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail, ensure};

use super::super::live::{stamp_now, stop_wish};
use super::super::tune::request::least_protrusion;
use super::{Arguments, consent};
use crate::config::edit::MachineFile;
use crate::config::plan::CircleRequest;
use crate::config::{EMBEDDED, Machine};
use crate::offline::identify::plan::{Plan, Request};
use crate::offline::tune::gain_set;
use crate::offline::tune::space::Choice;
use crate::offline::tune::whole::{DIRECTIONS, circle};
use crate::offline::tune::window;
use crate::run::Place;

/// The first circle with new gains runs at this share of the feed.
pub(super) const REDUCED: f64 = 0.5;
/// A circle is of two axes, and gains are for axes that a circle has shown.
const AXES: usize = 2;

/// What all steps share.
pub(super) struct Setup<'a> {
    pub(super) arguments: &'a Arguments,
    /// As its file says.
    pub(super) machine: Machine,
    /// Behind the boards, where it is simulated in this process.
    pub(super) plant: Machine,
    pub(super) place: Place<'a>,
    pub(super) path: window::Path,
    /// The gains that are there.
    pub(super) given: Choice,
    pub(super) experiments: Request,
    pub(super) plan: Plan,
    pub(super) folder: PathBuf,
    pub(super) stamp: String,
    pub(super) stop: Arc<AtomicBool>,
}

impl<'a> Setup<'a> {
    /// The setup, and the machine file that is to take the result, as it is read.
    pub(super) fn of(arguments: &'a Arguments) -> anyhow::Result<(Self, MachineFile)> {
        let [machine, plant] = arguments.stage.machines()?;
        let count = machine.axes.count();
        ensure!(
            count == AXES,
            "machine {} has {count} axes; autotune is for axes x and y alone: others would get gains that no circle \
             has shown. Tune them with `quadrant identify` and `quadrant tune`",
            machine.name
        );
        let (search, set) = least_protrusion(&arguments.search, &machine)?;
        let path = search.path;
        for share in [1.0, REDUCED] {
            machine.circle_test(&circle_request(&arguments.search.from, &path.at(share)))?;
        }
        let experiments = Request { gains: arguments.search.from.clone(), axes: Vec::new() };
        let plan = Plan::of(&machine, &experiments)?;
        if plan.steps.is_empty() {
            bail!("machine {}: no experiment is possible: {}", machine.name, plan.left_out.join("; "));
        }
        gain_set::has_room(&machine, &arguments.name)?;
        let stamp = stamp_now();
        let folder = arguments.out.clone().unwrap_or_else(|| {
            PathBuf::from("quadrant-out").join(format!("{stamp}-autotune-{}", machine.name))
        });
        let target = target(arguments, &machine, &folder);
        let file = gain_set::opened(&target, &machine)?;
        // A new file is read with the sheets beside it.
        file.machine()?;
        if let Some(parent) =
            target.parent().filter(|parent| *parent != folder && !parent.as_os_str().is_empty())
        {
            ensure!(parent.is_dir(), "{}: there is no folder {}", target.display(), parent.display());
        }
        consent::is_possible(arguments.yes)?;
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("cannot create the output folder {}", folder.display()))?;
        let place = arguments.stage.place(arguments.search.seed);
        let stop = stop_wish(&place)?;
        let given = Choice::of_set(&machine, set);
        let setup =
            Self { arguments, machine, plant, place, path, given, experiments, plan, folder, stamp, stop };
        Ok((setup, file))
    }

    /// A file in the folder of the logs.
    pub(super) fn log(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}-{}.mcap", self.stamp))
    }
}

/// The file that is to take the result: the machine file itself, unless another is named; a machine that comes with
/// the program has no file.
fn target(arguments: &Arguments, machine: &Machine, folder: &Path) -> PathBuf {
    let is_embedded = EMBEDDED.iter().any(|(name, _)| *name == arguments.stage.machine);
    match &arguments.write {
        Some(file) => file.clone(),
        None if is_embedded => folder.join(format!("{}.toml", machine.name)),
        None => PathBuf::from(&arguments.stage.machine),
    }
}

/// The test of a path with a gain set.
pub(super) fn circle_request(gains: &str, path: &window::Path) -> CircleRequest {
    CircleRequest { gains: gains.to_owned(), circle: circle(path), directions: DIRECTIONS.to_vec() }
}
